"""Torque samples of logs, and the load that a model predicts at them: servo law, limits, friction and inertia."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_model.effects.base import Motion, TorqueEffect
from spot_model.plant.model_fields import LossMotion, has_joint_loss, joint_losses_nm
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.joints import select_joints
from trainer.signals.motor_torque import nominal_torque_nm
from trainer.signals.recording import Recording
from trainer.signals.smoothing import eroded
from trainer.sysid.config import SearchSpace

SLOPE_WEIGHTS: Final = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
"""Slope in the middle of five neighbouring samples, per sample period; exact for polynomials up to the fourth degree.

A least-squares line would be three times less noisy, but 17 % short at 30 Hz: at a knee's reversal, where the largest
torques are, that is several N·m of inertia that would be taken for a limit.
"""
BEND_WEIGHTS: Final = np.array([2.0, -1.0, -2.0, -1.0, 2.0]) / 7.0
"""Second derivative of the least-squares parabola through them, per squared sample period."""
STOP_MARGIN_RAD: Final = 0.05
"""Nearer than this to a joint stop, the stop's own torque is in the load."""


@dataclass(frozen=True)
class TorqueSamples:
    """Rows of all runs; arrays of shape (n, 12) in canonical joint order."""

    run: NDArray[np.intp]
    """Which run a row comes from, shape (n,)."""
    state: NDArray[np.intp]
    """Number of the state within its run's stretch, shape (n,); rising within a run."""
    setpoint_rad: Array
    position_rad: Array
    velocity_rad_s: Array
    acceleration_rad_s2: Array
    """Slope of the measured velocity, from five samples."""
    jerk_rad_s3: Array
    """Its change, from the same five samples."""
    velocity_doubt_rad_s: Array
    """How far the velocity may have been from the measured one when the torque was made: half the largest second
    difference around the sample. Large in impacts.
    """
    kp_nm_per_rad: Array
    kd_nm_s_per_rad: Array
    load_nm: Array

    def __len__(self) -> int:
        return len(self.run)

    @property
    def request_nm(self) -> Array:
        """Torque that the servo's law asks for, before any limit."""
        return self.asked_nm(self.position_rad, self.velocity_rad_s)

    def asked_nm(self, position_rad: Array, velocity_rad_s: Array) -> Array:
        """Torque that the servo's law asks of joints at other positions and velocities, shape (n, 12)."""
        return self.kp_nm_per_rad * (self.setpoint_rad - position_rad) - self.kd_nm_s_per_rad * velocity_rad_s

    @property
    def is_off_the_stops(self) -> NDArray[np.bool_]:
        """Joints whose stops have no part in the load, shape (n, 12)."""
        above = self.position_rad > facts.POSITION_LOW_RAD + STOP_MARGIN_RAD
        below = self.position_rad < facts.POSITION_HIGH_RAD - STOP_MARGIN_RAD
        return np.asarray(above & below)

    def rows(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> TorqueSamples:
        """A selection of rows."""
        return replace(self, **{f.name: getattr(self, f.name)[index] for f in fields(self)})


def torque_samples(logs: Sequence[Recording]) -> TorqueSamples:
    """Collect the samples of logs, numbered in their order.

    Left out are the states before the first command, those by which a new set-point has just arrived (their load may
    still belong to the one before), those whose command is not in the log, and those without five neighbours at the
    stream's own period; and logs that do not say when commands were received.
    """
    parts = [_of_log(number, log) for number, log in enumerate(logs)]
    return TorqueSamples(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(TorqueSamples)})


def _of_log(number: int, log: Recording) -> TorqueSamples:
    n, commands, row = len(log), log.commands, log.command_row()
    known = (row >= 0) & log.has_receipts
    settled = np.zeros(n, dtype=np.bool_)
    acceleration, jerk, doubt = (np.zeros((n, facts.N_JOINTS)) for _ in range(3))
    if len(commands):
        setpoints = commands.position_rad[row]
        settled[1:] = known[:-1] & np.all(setpoints[1:] == setpoints[:-1], axis=1)
    if n >= len(SLOPE_WEIGHTS):
        windows = np.lib.stride_tricks.sliding_window_view(log.velocity_rad_s, len(SLOPE_WEIGHTS), axis=0)
        acceleration[2:-2] = windows @ SLOPE_WEIGHTS / log.period_s
        jerk[2:-2] = windows @ BEND_WEIGHTS / log.period_s**2
        bend = np.abs(np.diff(log.velocity_rad_s, n=2, axis=0)) / 2.0
        doubt[2:-2] = np.maximum.reduce([bend[:-2], bend[1:-1], bend[2:]])
    keep = known & settled & eroded(log.present, 2, 2) & np.isfinite(log.load_nm).all(axis=1)
    chosen = row[keep]
    return TorqueSamples(
        run=np.full(len(chosen), number, dtype=np.intp),
        state=np.flatnonzero(keep),
        setpoint_rad=commands.position_rad[chosen],
        position_rad=log.position_rad[keep],
        velocity_rad_s=log.velocity_rad_s[keep],
        acceleration_rad_s2=acceleration[keep],
        jerk_rad_s3=jerk[keep],
        velocity_doubt_rad_s=doubt[keep],
        kp_nm_per_rad=commands.kp_nm_per_rad[chosen],
        kd_nm_s_per_rad=commands.kd_nm_s_per_rad[chosen],
        load_nm=log.load_nm[keep],
    )


NUISANCE_NAMES: Final = (
    "time offset",
    "hip viscosity",
    "knee viscosity",
    "hip inertia",
    "knee inertia",
    "hip friction while turning",
    "knee friction while turning",
)
"""Numbers that are fitted beside the searched ones, so that what the model lacks does not bend them."""

NUISANCE_SCALE: Final = np.array([1e-3, 0.1, 0.1, 0.02, 0.02, 0.1, 0.1])
"""Their usual sizes: s, then twice each N·m·s/rad, kg·m², N·m."""

UNIT_STEP: Final = 1e-4
"""Step of numerical slopes in the unit cube."""
MIN_SPEED_RAD_S: Final = 0.3
"""A slower joint may stick: its friction has no known size, and none is predicted."""
TURNING_TIME_S: Final = 0.03
"""A joint that at its present acceleration would come to rest sooner is turning: the same holds for it."""
STEADY_RAD_S2: Final = 60.0
"""So does it for a joint that accelerates more than this, whose inertia outweighs its friction by far."""


@dataclass(frozen=True)
class TorqueModel:
    """Predicts load for values of a search space's parameters."""

    space: SearchSpace

    @cached_property
    def covered(self) -> NDArray[np.bool_]:
        """Which parameters this prediction depends on by its form, shape (n,).

        An effect that carries something from one step to the next is not among them: samples stand alone here.
        """
        effects = self.space.model.effects
        indices = [p.effect_index for p in self.space.parameters]
        return np.array([has_joint_loss(effects[i]) or i in self.torque_effects for i in indices])

    @cached_property
    def torque_effects(self) -> frozenset[int]:
        """Which effects of the model act on single samples of torque."""
        effects = enumerate(self.space.model.effects)
        return frozenset(i for i, e in effects if isinstance(e, TorqueEffect) and e.is_memoryless)

    def load_nm(self, samples: TorqueSamples, values: Array, nuisance: Array) -> Array:
        """Predicted load.

        Args:
            samples: n rows.
            values: Parameters of the search space. Shape (n_parameters,).
            nuisance: In the order of :data:`NUISANCE_NAMES`. The time offset is how much earlier than the sampled
                motion the torque was made; it then acted until the sample.

        Returns:
            Shape (n, 12), N·m.
        """
        motion = shifted_motion(samples, nuisance[0])
        losing = loss_motion(samples, motion, nuisance[0])
        turning = np.sign(motion.velocity_rad_s) - losing.direction
        beside = (
            _by_joint(nuisance[1], nuisance[2]) * losing.velocity_rad_s
            + _by_joint(nuisance[3], nuisance[4]) * losing.acceleration_rad_s2
            + _by_joint(nuisance[5], nuisance[6]) * turning
        )
        losses = joint_losses_nm(self.space.effects(values[None, :]), losing) + beside
        return np.asarray(self.motor_torque_nm(samples, values, motion) - losses)

    def motor_torque_nm(self, samples: TorqueSamples, values: Array, motion: Motion) -> Array:
        """Request after the model's torque effects, shape (n, 12), N·m."""
        effects = self.space.effects(values[None, :])
        acting = [effect for i, effect in enumerate(effects) if i in self.torque_effects]
        request, period_s = samples.asked_nm(motion.position_rad, motion.velocity_rad_s), motion.dt_s
        return nominal_torque_nm(acting, request, motion.position_rad, motion.velocity_rad_s, samples.run, period_s)

    def jacobian(self, samples: TorqueSamples, unit: Array, nuisance: Array) -> Array:
        """Slopes of the predicted load.

        Args:
            samples: n rows.
            unit: Parameters as a point of the unit cube. Shape (n_parameters,).
            nuisance: As for :meth:`load_nm`.

        Returns:
            Shape (n, 12, n_parameters + n_nuisance): by the unit cube's coordinates, then by the nuisance numbers over
            :data:`NUISANCE_SCALE`.
        """
        space = self.space
        values = space.values_of_unit(unit)
        motion = shifted_motion(samples, nuisance[0])
        losing = loss_motion(samples, motion, nuisance[0])
        velocity, acceleration = losing.velocity_rad_s, losing.acceleration_rad_s2
        turning = np.sign(velocity) - losing.direction

        def kept_nm(at: Array, index: int) -> Array:
            if index in self.torque_effects:
                return self.motor_torque_nm(samples, space.values_of_unit(at), motion)
            return -joint_losses_nm([space.effects(space.values_of_unit(at)[None, :])[index]], losing)

        columns = []
        for i, p in enumerate(space.parameters):
            low, high = unit.copy(), unit.copy()
            low[i], high[i] = max(0.0, unit[i] - UNIT_STEP), min(1.0, unit[i] + UNIT_STEP)
            change = kept_nm(high, p.effect_index) - kept_nm(low, p.effect_index)
            columns.append(change / (high[i] - low[i]))
        step_s = 1e-2 * NUISANCE_SCALE[0]
        below, above = (
            self.motor_torque_nm(samples, values, shifted_motion(samples, nuisance[0] + sign * step_s))
            for sign in (-1.0, 1.0)
        )
        lag = 0.5 * self.inertia_kg_m2(values, nuisance) * samples.jerk_rad_s3
        columns.append((above - below) / (2.0 * step_s) + lag)
        hip, knee = _by_joint(1.0, 0.0), _by_joint(0.0, 1.0)
        columns += [-velocity * hip, -velocity * knee, -acceleration * hip, -acceleration * knee]
        columns += [-turning * hip, -turning * knee]
        jacobian = np.stack(columns, axis=-1)
        jacobian[..., space.n :] *= NUISANCE_SCALE
        return jacobian

    def inertia_kg_m2(self, values: Array, nuisance: Array) -> Array:
        """Inertia between motor and torque sensor, shape (12,), kg·m²."""
        still = np.zeros((1, facts.N_JOINTS))
        held = joint_losses_nm(self.space.effects(values[None, :]), LossMotion(still, still + 1.0, still))
        return np.asarray(_by_joint(nuisance[3], nuisance[4]) + held[0])


def shifted_motion(samples: TorqueSamples, offset_s: float) -> Motion:
    """The joints' motion ``offset_s`` before the samples, to first order."""
    return Motion(
        samples.position_rad - offset_s * samples.velocity_rad_s,
        samples.velocity_rad_s - offset_s * samples.acceleration_rad_s2,
        facts.STATE_PERIOD_NS * 1e-9,
    )


def loss_motion(samples: TorqueSamples, motion: Motion, offset_s: float) -> LossMotion:
    """What friction and inertia see of the samples' motion, moved back by ``offset_s``."""
    direction = friction_direction(motion.velocity_rad_s, samples.acceleration_rad_s2)
    # The mean while the sampled torque acted, from the offset before the sample until then.
    acceleration = samples.acceleration_rad_s2 - 0.5 * offset_s * samples.jerk_rad_s3
    return LossMotion(motion.velocity_rad_s, acceleration, direction)


def friction_direction(velocity_rad_s: Array, acceleration_rad_s2: Array) -> Array:
    """Sign of the velocity where dry friction certainly has its full size, 0 elsewhere. Any shape.

    Left at 0 are slow joints, and those in an impact or at a reversal, where the friction of a real joint is not
    fully built up, and where a simulator's friction constraint opposes the impact and not the motion. There the
    friction has a size of its own, a nuisance.
    """
    speed = np.abs(velocity_rad_s)
    slow_change = np.abs(acceleration_rad_s2) < np.minimum(speed / TURNING_TIME_S, STEADY_RAD_S2)
    steady = (speed > MIN_SPEED_RAD_S) & slow_change
    return np.asarray(np.sign(velocity_rad_s) * steady)


def _by_joint(hip: float, knee: float) -> Array:
    return np.where(select_joints(("knees",)), knee, hip)
