"""Programs that send something else than the policy meant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spot_model.robot import facts
from spot_model.robot.facts import Array
from withheld.realities.fault_kind import Ask, Built, at, sign
from withheld.realities.robot import Robot

SCALE = 0.25
POSE_RAD = 0.08
SWAP = 0.4


def action_scale(ask: Ask) -> Built:
    """Another action scale than the policy's."""
    scale = 1.0 + sign(ask.rng) * ask.size * SCALE
    part = _Changed(np.where(ask.joints, scale, 1.0), np.zeros(facts.N_JOINTS), 0.0, ask.size)
    return _built(part, {"action_scale.scale": scale})


def default_pose(ask: Ask) -> Built:
    """Another default pose than the policy's."""
    offset = sign(ask.rng) * ask.size * POSE_RAD
    part = _Changed(np.ones(facts.N_JOINTS), at(ask.joints, offset), 0.0, ask.size)
    return _built(part, {"default_pose.offset_rad": offset})


def mixed_sides(ask: Ask) -> Built:
    """Left and right are mixed up, as by a wrong matrix in the program."""
    share = ask.size * SWAP
    part = _Changed(np.ones(facts.N_JOINTS), np.zeros(facts.N_JOINTS), at(ask.joints, share), ask.size)
    return _built(part, {"joint_swap.share": share})


def _built(part: _Changed, parameters: dict[str, float]) -> Built:
    def install(robot: Robot) -> None:
        if part.size > 0.0:
            robot.setpoints.append(part)

    return Built(install, parameters)


@dataclass(frozen=True)
class _Changed:
    scale: Array
    offset: Array
    share: Array | float
    size: float

    def act(self, setpoint_rad: Array) -> Array:
        """What the program sends."""
        about = facts.DEFAULT_POSITION_RAD
        sent = about + self.scale * (setpoint_rad - about) + self.offset
        legs = sent.reshape(len(sent), facts.N_LEGS, 3)
        other = legs[:, [1, 0, 3, 2]].reshape(sent.shape)
        return np.asarray(sent + self.share * (other - sent))
