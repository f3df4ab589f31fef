"""The gains: scales and offsets of a network's inputs and outputs, equal on left and right.

They are folded into the first and the last layer, so the refined policy has the same shape and costs the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import torch

from spot_model.policy.observation import COLUMNS, OBSERVATION
from spot_model.robot.facts import Array
from trainer.ppo.checkpoint_policy import Layers

OBSERVED_SCALE, ACTION_SCALE, OFFSET_SCALE = 0.15, 0.1, 0.15
_BODY = {
    "linear_vel_of_body_in_body_m_s": (0, 1, 2),
    "angular_vel_of_body_in_body_rad_s": (0, 1, 2),
    "projected_gravity_in_body": (0, 1),
    "velocity_command": (0, 2),
}
"""Columns of the body's features that get a gain."""


@dataclass(frozen=True)
class Gain:
    """One number of the search: 0 leaves the policy as it is."""

    name: str
    kind: Literal["observed", "action", "offset"]
    columns: tuple[int, ...]
    """Columns of the observation, or of the action."""
    signs: tuple[float, ...]
    """Signs of a shift, so that left and right stay mirror images."""
    scale: float


def gains_of(joint_names: Sequence[str]) -> tuple[Gain, ...]:
    """All gains of a policy with this joint order: 10 of the body, 18 of the joints' features, 12 of the action."""
    gains = [
        Gain(f"{name}[{i}]", "observed", (COLUMNS[name].start + i,), (1.0,), OBSERVED_SCALE)
        for name, columns in _BODY.items()
        for i in columns
    ]
    groups = {
        f"{end}_{kind}": _joints(joint_names, end, kind) for end in ("front", "hind") for kind in ("hx", "hy", "kn")
    }
    for name in (field.name for field in OBSERVATION if field.is_of_joints):
        for group, joints in groups.items():
            columns = tuple(COLUMNS[name].start + j for j in joints)
            gains.append(Gain(f"{name}.{group}", "observed", columns, (1.0,) * len(columns), OBSERVED_SCALE))
    for group, joints in groups.items():
        signs = tuple(-1.0 if joint_names[j].endswith("r_hx") else 1.0 for j in joints)
        gains.append(Gain(f"action.{group}", "action", joints, signs, ACTION_SCALE))
        gains.append(Gain(f"offset.{group}", "offset", joints, signs, OFFSET_SCALE))
    return tuple(gains)


def gains_in(layers: Layers, gains: Sequence[Gain], values: Array) -> Layers:
    """The network with its gains.

    Args:
        layers: Weight (out, in) and bias (out,) of each layer.
        gains: What the values mean.
        values: One number a gain, in units of its scale; zeros give ``layers`` back.
    """
    changed = [(weight.double().clone(), bias.double().clone()) for weight, bias in layers]
    (first, _), (last, last_bias) = changed[0], changed[-1]
    for gain, value in zip(gains, values * [g.scale for g in gains], strict=True):
        columns = list(gain.columns)
        if gain.kind == "observed":
            first[:, columns] *= 1.0 + value
        elif gain.kind == "action":
            last[columns] *= 1.0 + value
            last_bias[columns] *= 1.0 + value
        else:
            last_bias[columns] += torch.tensor(gain.signs, dtype=torch.float64) * value
    return [(weight.float(), bias.float()) for weight, bias in changed]


def _joints(names: Sequence[str], end: str, kind: str) -> tuple[int, ...]:
    return tuple(i for i, name in enumerate(names) if name[0] == end[0] and name.endswith(kind))
