"""Effects of a batch of simulations that act one after the other, with their memories.

A chain of torque effects follows the servo law; chains of sensor and estimator effects turn the true state into what
the robots report.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

import numpy as np

from spot_model.effects.base import (
    BodyEstimate,
    CommandEffect,
    Draws,
    Effect,
    EstimateEffect,
    JointReading,
    Memory,
    ModelEffect,
    Motion,
    Outside,
    OutsideEffect,
    SensorEffect,
    SoftwareEffect,
    TorqueEffect,
)
from spot_model.effects.ground import level_turn_wxyz
from spot_model.plant.command_channel import ServoCommand
from spot_model.plant.memory import keeper, leaves, own_tensors, restarted, tensors_of, with_leaves
from spot_model.robot import facts
from spot_model.robot.arrays import copy_of, namespace_of
from spot_model.robot.control import pd_torque
from spot_model.robot.rotation import AnyArray, cross, multiply_wxyz

EffectKind = TypeVar("EffectKind", TorqueEffect, SensorEffect, EstimateEffect)


class EffectChain(Generic[EffectKind]):
    """Effects of one kind with their memories.

    Args:
        effects: In the order in which they act.
        like: An array of the simulations, shape (n_sims, 12).
        first: What the memories start from: a torque, a reading or an estimate.
    """

    def __init__(self, effects: Sequence[EffectKind], like: AnyArray, first: Any) -> None:
        self._keep = keeper(like)
        self.given: tuple[EffectKind, ...] = tuple(effects)
        self._effects: tuple[EffectKind, ...] = tuple(effect.arrays_like(like) for effect in effects)
        self._memory: list[Memory] = [own_tensors(effect.start(first)) for effect in self._effects]

    def leaves(self) -> list[Any]:
        """On a GPU, the tensors of all memories."""
        return tensors_of(self._memory)

    def reset(self, rows: AnyArray, first: Any) -> None:
        """Start the memories afresh in the simulations of ``rows``, shape (n_sims,)."""
        self._restart(rows, [effect.start(first) for effect in self._effects])

    def snapshot(self) -> list[list[Any]]:
        """The memories as plain arrays and numbers, one list an effect."""
        return [leaves(memory) for memory in self._memory]

    def restore(self, snapshot: list[list[Any]]) -> None:
        """Continue from a snapshot. Raises ValueError: it was made with other effects."""
        if len(snapshot) != len(self._effects):
            raise ValueError(f"the snapshot has memories of {len(snapshot)} effects, the plant {len(self._effects)}")
        self._memory = [with_leaves(memory, values) for memory, values in zip(self._memory, snapshot, strict=True)]

    def remember(self, before: EffectChain[EffectKind]) -> None:
        """Take over the memories of the effects that another chain has, too."""
        known = list(zip(before.given, before._memory, strict=True))
        for i, effect in enumerate(self.given):
            kept = [memory for other, memory in known if other is effect]
            self._memory[i] = kept[0] if kept else self._memory[i]

    def _restart(self, rows: AnyArray, fresh: Sequence[Memory]) -> None:
        for i, memory in enumerate(fresh):
            self._memory[i] = self._keep(self._memory[i], restarted(rows, memory, self._memory[i]))


class TorqueChain(EffectChain[TorqueEffect]):
    """Motor torque of the active command: the servo law, then the torque effects, on arrays like ``like``, (n, 12)."""

    def __init__(self, effects: Sequence[TorqueEffect], like: AnyArray) -> None:
        xp = namespace_of(like)
        self._where = xp.where
        super().__init__(effects, like, xp.zeros_like(like))
        # Made once: what an effect starts with may have to be copied to a GPU, for which no recorded work can wait.
        self._fresh = [effect.start(xp.zeros_like(like)) for effect in self._effects]
        self._masks = tuple(None if effect.mask.all() else effect.mask_like(like) for effect in self._effects)

    def torque_nm(self, command: ServoCommand, motion: Motion, reading: JointReading | Motion) -> AnyArray:
        """Motor torque at this physics step; moves the effects' memories on by one step.

        Returns:
            Shape (n_sims, 12), N·m.
        """
        damped = reading.servo_velocity_rad_s if isinstance(reading, JointReading) else None
        torque = pd_torque(
            position_rad=reading.position_rad,
            velocity_rad_s=reading.velocity_rad_s if damped is None else damped,
            setpoint_position_rad=command.position_rad,
            setpoint_velocity_rad_s=command.velocity_rad_s,
            feedforward_nm=command.load_nm,
            kp_nm_per_rad=command.kp_nm_per_rad,
            kd_nm_s_per_rad=command.kd_nm_s_per_rad,
        )
        for i, (effect, mask) in enumerate(zip(self._effects, self._masks, strict=True)):
            # As Effect.apply does, without its look-up of the array library.
            changed, memory = effect.torque(torque, motion, self._memory[i])
            self._memory[i] = self._keep(self._memory[i], memory)
            torque = changed if mask is None else self._where(mask, changed, torque)
        return torque

    def reset_from_rest(self, rows: AnyArray) -> None:
        """Start the memories afresh, from no torque, in the simulations of ``rows``, shape (n_sims,)."""
        self._restart(rows, self._fresh)


class SensorChain(EffectChain[SensorEffect]):
    """What the joints' sensors report."""

    def read(self, truth: JointReading, dt_s: float, rng: Draws) -> JointReading:
        """The reading after all effects; moves the memories on by ``dt_s``."""
        for i, effect in enumerate(self._effects):
            truth, memory = effect.read(truth, dt_s, self._memory[i], rng)
            self._memory[i] = self._keep(self._memory[i], memory)
        return truth


class EstimateChain(EffectChain[EstimateEffect]):
    """What the state estimator reports."""

    def estimate(self, truth: BodyEstimate, joints: JointReading, dt_s: float, rng: Draws) -> BodyEstimate:
        """The estimate after all effects, given what the joints report; moves the memories on by ``dt_s``."""
        for i, effect in enumerate(self._effects):
            truth, memory = effect.estimate(truth, joints, dt_s, self._memory[i], rng)
            self._memory[i] = self._keep(self._memory[i], memory)
        return truth


LEAST_M_S2 = 1e-12


class OutsideChain:
    """Gravity, and forces on the feet of a batch of simulations; without an effect on them, nothing.

    Args:
        effects: All that act; the others are left aside.
        model: MuJoCo's.
        live: Gives a live array of MuJoCo's data by its name, with the simulations as first axis.
        gravity: Gives the live gravity, shape (n, 3).
    """

    def __init__(
        self, effects: Sequence[Effect], model: Any, live: Callable[[str], AnyArray], gravity: Callable[[], AnyArray]
    ) -> None:
        self._qpos, self._qvel = live("qpos"), live("qvel")
        given = of_kind(effects, OutsideEffect)
        self._effects = [effect.arrays_like(self._qpos) for effect in given]
        self._is_steady, self._turn = all(effect.is_steady for effect in given), None
        # Slices, since a GPU's recorded work may not fetch a list of numbers.
        feet = _evenly([model.geom(f"{leg}_foot").id for leg in facts.LEG_NAMES])
        shanks = _evenly([model.body(f"{leg}_lleg").id for leg in facts.LEG_NAMES])
        self._pushed = live("xfrc_applied")[:, shanks]
        self._pushed[...] = 0.0
        if self._effects:
            self._feet, self._centres = live("geom_xpos")[:, feet], live("xipos")[:, shanks]
            self._gravity = gravity()
            self._upright = copy_of(self._gravity)
            self._surround(0.0)
            self._turn = self._odom_from_ground_wxyz()

    def act(self, time_s: Any) -> None:
        """Set gravity and forces for the next physics step, so long after the start: shape (n,), or a number."""
        if not self._is_steady:
            self._surround(time_s)

    def _surround(self, time_s: Any) -> None:
        elapsed_s = 0.0 * self._qpos[:, :1] + (time_s if isinstance(time_s, float) else time_s[:, None])
        self._gravity[...], force = self._upright, 0.0 * self._feet
        for effect in self._effects:
            effect.surround(Outside(self._gravity, force, self._qpos, self._qvel, elapsed_s))
        self._pushed[...] = namespace_of(force).concat([force, cross(self._feet - self._centres, force)], axis=2)

    def odom_from_ground_wxyz(self) -> AnyArray | None:
        """What turns the frame of the ground into one that is true to gravity, (n, 4); None where it is."""
        return self._turn if self._is_steady else self._odom_from_ground_wxyz()

    def _odom_from_ground_wxyz(self) -> AnyArray:
        x, y, z = (self._gravity[:, i : i + 1] for i in range(3))
        level = namespace_of(z).clip(namespace_of(z).sqrt(x * x + y * y), LEAST_M_S2, None)
        steep = namespace_of(z).atan2(level, -z) / level
        return level_turn_wxyz(x * steep, y * steep)

    def in_odom(self, ground_from_body_wxyz: AnyArray) -> AnyArray:
        """Attitudes against the vertical, shape (n, 4)."""
        turn = self.odom_from_ground_wxyz()
        return ground_from_body_wxyz if turn is None else multiply_wxyz(turn, ground_from_body_wxyz)


def _evenly(numbers: Sequence[int]) -> slice:
    return slice(numbers[0], numbers[-1] + 1, numbers[1] - numbers[0])


def of_kind(effects: Sequence[Effect], kind: Any) -> list[Any]:
    """The effects of one kind, in their order."""
    return [effect for effect in effects if isinstance(effect, kind)]


PLACES = (ModelEffect, TorqueEffect, CommandEffect, SoftwareEffect, SensorEffect, EstimateEffect, OutsideEffect)
"""Kinds of effect that the plant has a place for."""


def check_effects(effects: Sequence[Effect], n_sims: int) -> None:
    """Refuse effects that so many simulations cannot have.

    Raises:
        TypeError: An effect acts at no place that the plant has.
        ValueError: A parameter is neither one number nor one for each simulation or joint.
    """
    allowed = ((), (1, 1), (n_sims, 1), (1, facts.N_JOINTS), (n_sims, facts.N_JOINTS))
    for effect in effects:
        if not isinstance(effect, PLACES):
            raise TypeError(f"effect {effect.name} acts at {effect.hook.value}; the plant has no such place")
        for name, value in effect.values.items():
            if np.shape(value) not in allowed:
                raise ValueError(
                    f"{effect.name}.{name} has shape {np.shape(value)}; allowed for {n_sims} simulations: "
                    f"a number, ({n_sims}, 1) or ({n_sims}, {facts.N_JOINTS})"
                )
