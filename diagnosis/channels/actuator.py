"""Channel *set-point to load*: what the servo law asks against the load that is measured, joint by joint.

Time convention: the load at a state's stamp was asked for a short time earlier, the load's lag. The lag is found from
the steps that new set-points make, of which the log knows the instant, and the servo law is evaluated at the stamp less
the lag: joints interpolated between states, and the command that was in effect then.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from scipy.ndimage import binary_dilation
from scipy.signal import lfilter

from diagnosis.channels import Array, Channel, ChannelView, Flags
from diagnosis.channels.load_lag import between_states, load_lag_s
from diagnosis.channels.stack import Stack, white_noise
from spot_model.effects.base import Effect, TorqueEffect
from spot_model.plant.model_fields import LossMotion, has_joint_loss, joint_losses_nm
from spot_model.robot.control import pd_torque
from spot_model.robot.facts import N_JOINTS
from trainer.signals.motor_torque import check_joints, direction, nominal_torque_nm, torque_after_nm
from trainer.signals.smoothing import smooth, smooth_windows, windows

STRIDE: Final = 2
"""Every second row is kept: smoothed signals have nothing above half the rate."""
COMMANDED: Final = ("position_rad", "velocity_rad_s", "load_nm", "kp_nm_per_rad", "kd_nm_s_per_rad")
STOP_MARGIN_RAD: Final = 0.02
BEFORE_FLAG, AFTER_FLAG = 5, 2
"""States around a change of the contact flag that are left out: flags come late."""


@dataclass(frozen=True)
class ActuatorSignals:
    """What the load may depend on, N rows at the full rate, at the load's instants. J joints."""

    stack: Stack
    position_rad: Array
    velocity_rad_s: Array
    still_velocity_rad_s: Array
    """Smoothed, for what depends on the direction of motion."""
    inertial_velocity_rad_s: Array
    """Half a lag later: the velocity whose rate of change goes with the load over the lag's span."""
    kd_nm_s_per_rad: Array
    """Damping gain of the command in effect; 0 before the first."""
    request_nm: Array
    """The servo law."""
    torque_nm: Array
    """The servo law after the nominal model's torque effects: what its motors give."""
    load_nm: Array
    command_age_s: Array
    """Since the command in effect was received. Shape (N,)."""
    lag_s: float
    effects: tuple[Effect, ...] = ()
    """Effects of the nominal model."""
    cache: dict[object, Any] = field(default_factory=dict, compare=False)
    """Columns that are expensive to compute, by who computed them."""
    stride: int = STRIDE
    """Every so many rows one is kept."""

    @property
    def period_s(self) -> float:
        """Time between rows."""
        return self.stack.period_s

    @property
    def kept(self) -> slice:
        """The rows of the channel."""
        return slice(None, None, self.stride)

    def thinned(self, apart: int) -> tuple[ActuatorSignals, slice]:
        """Signals of rows ``apart`` states from each other, or a little less, and these rows."""
        every = max(1, apart // self.stride)
        return replace(self, stride=self.stride * every, cache={}), slice(None, None, every)

    def finish(self, raw: Array) -> Array:
        """A raw column of shape (N, J) as the channel's rows have it: smoothed, at those that are kept."""
        return smooth(raw, self.kept)

    def finished(self, formula: Callable[[Array, Array, Array], Array]) -> Array:
        """:meth:`finish` of what a formula without memory makes of motor torque, position and velocity, each (m, J).

        It sees only the rows that used ones are smoothed over; where no row is used, there is 0.
        """
        if "windows" not in self.cache:
            used = np.flatnonzero(self.stack.used[self.kept])
            rows = windows(self.stack.n, used * self.stride).ravel()
            self.cache["windows"] = used, [x[rows] for x in (self.torque_nm, self.position_rad, self.velocity_rad_s)]
        used, motion = self.cache["windows"]
        found = formula(*motion)
        out = np.zeros((len(range(0, self.stack.n, self.stride)), *found.shape[1:]))
        out[used] = smooth_windows(found.reshape(len(used), -1, *found.shape[1:]))
        return out

    def finish_rate(self, raw: Array) -> Array:
        """The derivative of a raw column, likewise."""
        return self.stack.rate(raw, self.kept)

    def loss_motion(self) -> LossMotion:
        """The motion as the channel's rows have it, for losses between motor and load cell."""
        return LossMotion(
            velocity_rad_s=self.finish(self.velocity_rad_s),
            acceleration_rad_s2=self.finish_rate(self.inertial_velocity_rad_s),
            direction=self.finish(direction(self.still_velocity_rad_s)),
        )

    def added_nm(self, effect: TorqueEffect) -> Array:
        """What one more effect changes in the nominal motor torque, at every joint and row of the channel."""
        run, period_s = self.stack.run, self.period_s

        def changed(*motion: Array) -> Array:
            return _by_twelve(lambda t, p, v: torque_after_nm(effect, t, p, v, run, period_s), *motion) - motion[0]

        if effect.is_memoryless:
            return self.finished(changed)
        return self.finish(changed(self.torque_nm, self.position_rad, self.velocity_rad_s))

    def losses_nm(self, effect: Effect) -> Array:
        """What the effect takes away between motor and load cell, at every joint, as the channel's rows have it."""
        motion = self.loss_motion()
        return _by_twelve(
            lambda *columns: joint_losses_nm([effect], LossMotion(*columns)),
            motion.velocity_rad_s,
            motion.acceleration_rad_s2,
            motion.direction,
        )

    def delayed(self, raw: Array, delay_s: float) -> Array:
        """(N, J) as it was a delay ago, each recording by itself, zero before its start."""
        whole, share = divmod(delay_s / self.period_s, 1.0)
        taps = [*np.zeros(int(whole)), 1.0 - share, share]
        return self.stack.by_run(lambda part: lfilter(taps, 1.0, part, axis=0), raw)


def actuator_view(
    stack: Stack, effects: Sequence[Effect], limits_rad: tuple[Array, Array] | None = None
) -> ChannelView:
    """Build the channel *set-point to load*, with the nominal model's effects.

    A load at a joint's stop is not the motor's: ``limits_rad`` are the stops, low and high, shape (J,), where known.
    """
    lag_s, note = load_lag_s(stack)
    between = between_states(stack, lag_s)
    signals = _signals(stack, effects, lag_s)
    raw = signals.load_nm - signals.torque_nm
    response = signals.finish(raw) + _losses_nm(effects, signals.loss_motion())
    usable = np.repeat(stack.used[:, None], raw.shape[1], axis=1)
    if limits_rad is not None:
        low, high = limits_rad
        usable &= (signals.position_rad > low + STOP_MARGIN_RAD) & (signals.position_rad < high - STOP_MARGIN_RAD)
    usable &= ~_impacts(stack)
    kept = stack.inner(usable)[::STRIDE]
    return stack.joint_view(
        Channel.SET_POINT_TO_LOAD,
        signals.kept,
        response,
        stack.legs,
        unit="N·m",
        usable=kept,
        noise=white_noise(raw, usable),
        nuisance=signals.finish(between)[:, :, None],
        signals=signals,
        notes=(note,) if note else (),
    )


def stand_in_view(stack: Stack, effects: Sequence[Effect]) -> ChannelView:
    """What the nominal drive gives, for logs without loads.

    It tells nothing by itself. Effects take their columns from it, and show in the channels of the body, which compare
    it with the motion.
    """
    bare = _signals(stack, effects, 0.0)
    still = bare.still_velocity_rad_s
    motion = LossMotion(still, stack.rate(bare.velocity_rad_s), direction(still))
    load = bare.torque_nm - _losses_nm(effects, motion)
    nothing = np.zeros_like(load[bare.kept])
    return stack.joint_view(
        Channel.SET_POINT_TO_LOAD,
        bare.kept,
        nothing,
        stack.legs,
        unit="N·m",
        usable=np.repeat(stack.inner(stack.used)[bare.kept, None], nothing.shape[1], axis=1),
        noise=np.ones(nothing.shape[1]),
        signals=replace(bare, load_nm=load),
        is_measured=False,
    )


def _losses_nm(effects: Sequence[Effect], motion: LossMotion) -> Array | float:
    """What the nominal model's friction and rotors take between motor and load cell."""
    losing = [effect for effect in effects if has_joint_loss(effect)]
    for effect in losing:
        check_joints(effect, motion.velocity_rad_s.shape[1])
    return joint_losses_nm(losing, motion) if losing else 0.0


def _impacts(stack: Stack) -> Flags:
    """States at which a joint rattles, or its foot touches down or lifts off, shape (N, J)."""
    hit, legs = stack.rattles.copy(), stack.legs
    if stack.has("foot_contact"):
        contact = stack.states.foot_contact
        change = np.zeros_like(contact)
        change[1:] = contact[1:] != contact[:-1]
        reach = np.zeros((2 * BEFORE_FLAG + 1, 1), dtype=np.bool_)
        reach[: BEFORE_FLAG + AFTER_FLAG + 1] = True
        around = np.asarray(binary_dilation(change, reach))
        hit[:, legs >= 0] |= around[:, legs[legs >= 0]]
    return hit


def _signals(stack: Stack, effects: Sequence[Effect], lag_s: float) -> ActuatorSignals:
    """Signals a lag before each state: joints interpolated, and the servo law of the command in effect then."""
    now = stack.states.velocity_rad_s
    steps_s = np.concatenate([np.diff(r.time_s, prepend=-r.period_s) for r in stack.recordings])
    step_s = np.maximum(steps_s, 1e-9)[:, None]

    def before(values: Array, by_s: float) -> Array:
        earlier = np.concatenate([values[:1], values[:-1]])
        return np.asarray(values + np.minimum(by_s / step_s, 1.0) * (earlier - values))

    position, velocity = before(stack.states.position_rad, lag_s), before(now, lag_s)
    commands: dict[str, list[Array]] = {name: [] for name in COMMANDED}
    ages: list[Array] = []
    for recording in stack.recordings:
        row = recording.command_row(-lag_s)
        # Before the first command nothing is asked for.
        known, row = row >= 0, np.maximum(row, 0)
        for name, parts in commands.items():
            parts.append(np.where(known[:, None], getattr(recording.commands, name)[row], 0.0))
        age_s = (recording.stamp_ns - recording.command_ns[row]) * 1e-9 - lag_s
        ages.append(np.where(known, age_s, np.inf))
    asked = {name: np.nan_to_num(np.concatenate(parts)) for name, parts in commands.items()}
    request = pd_torque(
        position_rad=position,
        velocity_rad_s=velocity,
        setpoint_position_rad=asked["position_rad"],
        setpoint_velocity_rad_s=asked["velocity_rad_s"],
        feedforward_nm=asked["load_nm"],
        kp_nm_per_rad=asked["kp_nm_per_rad"],
        kd_nm_s_per_rad=asked["kd_nm_s_per_rad"],
    )
    return ActuatorSignals(
        stack=stack,
        position_rad=position,
        velocity_rad_s=velocity,
        still_velocity_rad_s=smooth(velocity),
        inertial_velocity_rad_s=before(now, 0.5 * lag_s),
        kd_nm_s_per_rad=asked["kd_nm_s_per_rad"],
        request_nm=request,
        torque_nm=nominal_torque_nm(effects, request, position, velocity, stack.run, stack.period_s),
        load_nm=stack.states.load_nm,
        command_age_s=np.concatenate(ages),
        lag_s=lag_s,
        effects=tuple(effects),
    )


def _by_twelve(compute: Callable[..., Array], *columns: Array) -> Array:
    """Effects know twelve joints: those of another robot are computed by twelve, the last ones beside zeros."""
    n_joints, parts = columns[0].shape[1], []
    for first in range(0, n_joints, N_JOINTS):
        twelve = [c[:, first : first + N_JOINTS] for c in columns]
        size = twelve[0].shape[1]
        parts.append(compute(*(np.pad(c, ((0, 0), (0, N_JOINTS - size))) for c in twelve))[:, :size])
    return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
