"""Mirror images of observations and actions: left and right exchanged."""

from __future__ import annotations

import functools

import torch

from spot_model.policy.observation import OBSERVATION
from spot_model.robot import facts

Tensor = torch.Tensor

_MIRROR_LEG = {"fl": "fr", "fr": "fl", "hl": "hr", "hr": "hl"}
JOINT_SOURCE = [facts.JOINT_NAMES.index(f"{_MIRROR_LEG[name[:2]]}_{name[3:]}") for name in facts.JOINT_NAMES]
JOINT_SIGN = [-1.0 if name.endswith("hx") else 1.0 for name in facts.JOINT_NAMES]


def mirror_action(action: Tensor) -> Tensor:
    """The mirror image of joint values (actions, offsets, velocities), shape (..., 12), canonical order."""
    source, sign = _joint_mirror(action.device)
    return action[..., source] * sign


def mirror_observation(observation: Tensor) -> Tensor:
    """The mirror image of an observation, shape (..., 48)."""
    source, sign = _observation_mirror(observation.device)
    return observation[..., source] * sign


@functools.lru_cache(maxsize=8)
def _joint_mirror(device: torch.device) -> tuple[Tensor, Tensor]:
    with torch.inference_mode(mode=False):
        return torch.tensor(JOINT_SOURCE, device=device), torch.tensor(JOINT_SIGN, device=device)


@functools.lru_cache(maxsize=8)
def _observation_mirror(device: torch.device) -> tuple[Tensor, Tensor]:
    """Source column and sign of each of the 48 columns of a mirrored observation."""
    source: list[int] = []
    sign: list[float] = []
    for field in OBSERVATION:
        first = len(source)
        source += [first + i for i in (JOINT_SOURCE if field.mirror is None else range(field.width))]
        sign += JOINT_SIGN if field.mirror is None else field.mirror
    with torch.inference_mode(mode=False):
        return torch.tensor(source, device=device), torch.tensor(sign, device=device)
