"""Commands that come late, unevenly, or not at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spot_model.robot.facts import Array
from withheld.realities.fault_kind import Ask, Parameters
from withheld.simulator.robot import Robot

DELAY_S = 0.012
JITTER_S = 0.004
LOSS = 0.05


def delay(robot: Robot, ask: Ask) -> Parameters:
    """A queue on the way: a wait that wanders slowly about its mean."""
    mean = ask.size * DELAY_S
    robot.delays.append(_Queue(mean))
    return {"command_delay.delay_s": mean}


def jitter(robot: Robot, ask: Ask) -> Parameters:
    """A link that stutters: short waits as a rule, long ones now and then (Weibull)."""
    mean = ask.size * JITTER_S
    robot.delays.append(_Stutter(mean))
    return {"command_jitter.mean_s": mean}


def losses(robot: Robot, ask: Ask) -> Parameters:
    """A link that loses commands in bursts (Gilbert and Elliott's two states)."""
    share = ask.size * LOSS
    robot.delays.append(_Bursts(share))
    return {"command_drop.probability": share}


@dataclass(frozen=True)
class _Queue:
    mean_s: float
    WANDER = 0.06
    MEMORY = 0.97

    def extra_s(self, n_commands: int, rng: np.random.Generator) -> Array:
        """A mean and a first-order random walk about it."""
        steps = rng.standard_normal(n_commands) * np.sqrt(1.0 - self.MEMORY**2)
        walk = np.empty(n_commands)
        now = 0.0
        for i, step in enumerate(steps.tolist()):
            now = self.MEMORY * now + step
            walk[i] = now
        return np.asarray(np.maximum(self.mean_s * (1.0 + self.WANDER * walk), 0.0))


@dataclass(frozen=True)
class _Stutter:
    mean_s: float
    SHAPE = 0.8
    MEAN_OF_SHAPE = 1.133
    """Of Weibull's distribution with scale 1: Γ(1 + 1/0.8)."""

    def extra_s(self, n_commands: int, rng: np.random.Generator) -> Array:
        """Independent waits."""
        return np.asarray(self.mean_s / self.MEAN_OF_SHAPE * rng.weibull(self.SHAPE, n_commands))


@dataclass(frozen=True)
class _Bursts:
    share: float
    LEAVE = 0.7
    """Chance that a burst ends with each command."""

    def extra_s(self, n_commands: int, rng: np.random.Generator) -> Array:
        """Infinity where a command is lost."""
        enter = self.share * self.LEAVE / (1.0 - self.share)
        draws = rng.random(n_commands).tolist()
        lost = np.zeros(n_commands, dtype=np.bool_)
        bad = False
        for i, draw in enumerate(draws):
            bad = draw >= self.LEAVE if bad else draw < enter
            lost[i] = bad
        return np.where(lost, np.inf, 0.0)
