"""The link: a beat between two clocks, waits with a heavy tail, commands lost one by one; and the sending program."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from spot_model.robot import facts
from spot_model.robot.facts import STATE_PERIOD_NS, Array
from withheld.realities.fault_kind import BODY, Ask, FaultKind, Parameters, at, sign
from withheld.simulator.robot import Robot

DELAY_S: Final = 0.012
JITTER_S: Final = 0.004
TAIL: Final = 0.9
"""Standard deviation of the logarithm of a wait."""
LOSS: Final = 0.06
BEAT_S, BEAT_SHARE = 0.7, 0.15
SCALE, POSE_RAD, SWAP = 0.25, 0.08, 0.4


@dataclass(frozen=True)
class Wait:
    """Extra delays by a function of the number of commands and a generator."""

    draw: Callable[[int, np.random.Generator], Array]

    def extra_s(self, n_commands: int, rng: np.random.Generator) -> Array:
        """Shape (n_commands,), infinity for a lost command."""
        return self.draw(n_commands, rng)


def late(robot: Robot, ask: Ask) -> Parameters:
    """A fixed delay with the sawtooth of two clocks that drift past each other."""
    mean = ask.size * DELAY_S

    def draw(n: int, rng: np.random.Generator) -> Array:
        turns = np.arange(n) * STATE_PERIOD_NS * 1e-9 / BEAT_S + rng.random()
        return np.asarray(mean * (1.0 + BEAT_SHARE * (2.0 * (turns % 1.0) - 1.0)))

    robot.delays.append(Wait(draw))
    return {"command_delay.delay_s": mean}


def uneven(robot: Robot, ask: Ask) -> Parameters:
    """Log-normal waits."""
    mean = ask.size * JITTER_S

    def draw(n: int, rng: np.random.Generator) -> Array:
        return np.asarray(mean * np.exp(TAIL * rng.standard_normal(n) - 0.5 * TAIL**2))

    robot.delays.append(Wait(draw))
    return {"command_jitter.mean_s": mean}


def lost(robot: Robot, ask: Ask) -> Parameters:
    """Commands that are lost one by one."""
    share = ask.size * LOSS
    wait = Wait(lambda n, rng: np.where(rng.random(n) < share, np.inf, 0.0))
    robot.delays.append(wait)
    return {"command_drop.probability": share}


@dataclass(frozen=True)
class Program:
    """Set-points as scale, offset and a share of the other side's."""

    scale: Array
    offset: Array
    share: Array

    def act(self, setpoint_rad: Array) -> Array:
        """What the program sends."""
        about = facts.DEFAULT_POSITION_RAD
        sent = about + self.scale * (setpoint_rad - about) + self.offset
        legs = sent.reshape(len(sent), facts.N_LEGS, 3)
        return np.asarray(sent + self.share * (legs[:, [1, 0, 3, 2]].reshape(sent.shape) - sent))


def scaled(robot: Robot, ask: Ask) -> Parameters:
    """Another action scale than the policy's."""
    change = sign(ask.rng) * ask.size * SCALE
    part = Program(1.0 + at(ask.joints, change), np.zeros(12), np.zeros(12))
    robot.setpoints.append(part)
    return {"action_scale.scale": 1.0 + change}


def shifted(robot: Robot, ask: Ask) -> Parameters:
    """Another default pose than the policy's."""
    offset = sign(ask.rng) * ask.size * POSE_RAD
    part = Program(np.ones(12), at(ask.joints, offset), np.zeros(12))
    robot.setpoints.append(part)
    return {"default_pose.offset_rad": offset}


def swapped(robot: Robot, ask: Ask) -> Parameters:
    """Left and right are mixed, as by a wrong matrix."""
    share = ask.size * SWAP
    part = Program(np.ones(12), np.zeros(12), at(ask.joints, share))
    robot.setpoints.append(part)
    return {"joint_swap.share": share}


KINDS: Final = (
    FaultKind("drifting_clocks", "transport", ("command_delay",), BODY, late),
    FaultKind("uneven_waits", "transport", ("command_jitter",), BODY, uneven),
    FaultKind("lost_commands", "transport", ("command_drop",), BODY, lost),
    FaultKind("other_action_scale", "software", ("action_scale",), ("type", "all"), scaled),
    FaultKind("other_pose", "software", ("default_pose",), ("joint", "type"), shifted),
    FaultKind("mixed_sides", "software", ("joint_swap",), ("type",), swapped),
)
