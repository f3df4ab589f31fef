"""Channel *set-point to load*: what the servo law asks against the load that is measured, joint by joint.

Time convention: the load at a state's stamp was asked for a short time earlier, the load's lag. The lag is found from
the steps that new set-points make, of which the log knows the instant, and the servo law is evaluated at the stamp
less the lag: joints interpolated between states, and the command that was in effect then.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.signal import lfilter

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelOff, ChannelView, Flags, Ints
from diagnosis.channels.drive.chatter import rattling
from diagnosis.channels.drive.load_lag import load_lag_s
from diagnosis.channels.drive.nominal_torque import check_joints, direction, nominal_torque_nm, torque_after_nm
from diagnosis.channels.low_pass import low_pass
from diagnosis.channels.stack import Stack, white_noise
from spot_model.effects.base import Effect, TorqueEffect
from spot_model.plant.joint_losses import LossMotion, has_joint_loss, joint_losses_nm
from spot_model.robot.control import pd_torque
from spot_model.robot.facts import N_JOINTS

STRIDE: Final = 2
"""Every second row is kept: smoothed signals have nothing above half the rate."""
STOP_MARGIN_RAD: Final = 0.02
BEFORE_FLAG: Final = 5
AFTER_FLAG: Final = 2
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
    """Of the command in effect; 0 before the first."""
    request_nm: Array
    """The servo law."""
    torque_nm: Array
    """The servo law after the nominal model's torque effects: what its motors give."""
    load_nm: Array
    command_age_s: Array
    """Since the command in effect was received. Shape (N,)."""
    lag_s: float
    effects: tuple[Effect, ...] = ()
    """Of the nominal model."""
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

    def thinned(self, every: int) -> tuple[ActuatorSignals, slice]:
        """Signals of one of ``every`` rows, and these rows."""
        return replace(self, stride=self.stride * every, cache={}), slice(None, None, every)

    def finish(self, raw: Array) -> Array:
        """A raw column of shape (N, J) as the channel's rows have it: smoothed, at those that are kept."""
        return self.stack.smooth(raw, self.kept)

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

    def torque_after_nm(self, effect: TorqueEffect) -> Array:
        """The nominal motor torque after one more effect, at every joint. Shape (N, J)."""
        run, period_s = self.stack.run, self.period_s
        return _by_twelve(
            lambda torque, position, velocity: torque_after_nm(effect, torque, position, velocity, run, period_s),
            self.torque_nm,
            self.position_rad,
            self.velocity_rad_s,
        )

    def losses_nm(self, effect: Effect) -> Array:
        """What the effect takes away between motor and load cell, at every joint, as the channel's rows have it."""
        motion = self.loss_motion()
        return _by_twelve(
            lambda *columns: joint_losses_nm([effect], LossMotion(*columns)),
            motion.velocity_rad_s,
            motion.acceleration_rad_s2,
            motion.direction,
        )

    def low_pass(self, raw: Array, time_constant_s: float) -> Array:
        """First-order low pass of (N, J), each recording by itself, starting at rest at its first value."""
        return low_pass(self.stack, raw, time_constant_s)

    def delayed(self, raw: Array, delay_s: float) -> Array:
        """(N, J) as it was a delay ago, each recording by itself, zero before its start."""
        whole, share = divmod(delay_s / self.period_s, 1.0)
        out = np.zeros_like(raw)
        for number in range(len(self.stack.recordings)):
            rows = self.stack.run == number
            for steps, weight in ((int(whole), 1.0 - share), (int(whole) + 1, share)):
                kept = raw[rows][: max(0, int(rows.sum()) - steps)]
                out[np.flatnonzero(rows)[steps:]] += weight * kept
        return out

    def integrated(self, raw: Array, decay_s: float) -> Array:
        """Solution of dy/dt = raw − y/decay from zero at each recording's start, shape of ``raw``."""
        keep = float(np.exp(-self.period_s / decay_s))
        out = np.empty_like(raw)
        for number in range(len(self.stack.recordings)):
            rows = self.stack.run == number
            out[rows] = lfilter([self.period_s], [1.0, -keep], raw[rows], axis=0)
        return out


def actuator_view(
    stack: Stack, effects: Sequence[Effect], limits_rad: tuple[Array, Array] | None = None
) -> ChannelView | ChannelOff:
    """Build the channel *set-point to load*.

    Args:
        stack: The recordings.
        effects: The nominal model's.
        limits_rad: Joint stops, low and high, each of shape (J,): a load there is not the motor's. None if unknown.
    """
    for signal, name in (("load_nm", "torque"), ("position_rad", "position"), ("velocity_rad_s", "velocity")):
        if not all(r.has(signal) for r in stack.recordings):
            return ChannelOff(Channel.SET_POINT_TO_LOAD, f"no measured joint {name}")
    if any(len(r.commands) == 0 for r in stack.recordings):
        return ChannelOff(Channel.SET_POINT_TO_LOAD, "no commands")
    lag_s, note = load_lag_s(stack)
    signals = _signals(stack, effects, lag_s)
    raw = signals.load_nm - signals.torque_nm
    losing = [effect for effect in effects if has_joint_loss(effect)]
    for effect in losing:
        check_joints(effect, raw.shape[1])
    response = signals.finish(raw) + (joint_losses_nm(losing, signals.loss_motion()) if losing else 0.0)
    usable = np.repeat(stack.used[:, None], raw.shape[1], axis=1)
    if limits_rad is not None:
        low, high = limits_rad
        usable &= (signals.position_rad > low + STOP_MARGIN_RAD) & (signals.position_rad < high - STOP_MARGIN_RAD)
    usable &= ~_impacts(stack)
    kept = stack.inner(usable)[::STRIDE]
    n_joints = raw.shape[1]
    legs = leg_of_joint(stack.recordings[0].joint_names, stack.recordings[0].foot_names)
    return ChannelView(
        name=Channel.SET_POINT_TO_LOAD,
        rows=stack.recordings[0].joint_names,
        unit="N·m",
        response=response,
        usable=kept,
        run=stack.run[::STRIDE],
        state=stack.state[::STRIDE],
        noise=white_noise(raw, usable),
        nuisance=signals.finish(_between_states(stack, lag_s))[:, :, None],
        row_joint=np.arange(n_joints, dtype=np.intp),
        row_leg=legs,
        leg_of_joint=legs,
        signals=signals,
        measured={"load_lag_s": lag_s},
        notes=(note,) if note else (),
    )


def stand_in_view(stack: Stack, effects: Sequence[Effect]) -> ChannelView:
    """What the nominal drive gives, for logs without loads.

    It tells nothing by itself. Effects take their columns from it, and show in the channels of the body, which compare
    it with the motion.
    """
    bare = _signals(stack, effects, 0.0)
    losing = [effect for effect in effects if has_joint_loss(effect)]
    load = bare.torque_nm
    if losing:
        motion = LossMotion(
            velocity_rad_s=bare.still_velocity_rad_s,
            acceleration_rad_s2=stack.rate(bare.velocity_rad_s),
            direction=direction(bare.still_velocity_rad_s),
        )
        load = load - joint_losses_nm(losing, motion)
    signals = replace(bare, load_nm=load)
    legs = leg_of_joint(stack.recordings[0].joint_names, stack.recordings[0].foot_names)
    shape = signals.finish(load).shape
    return ChannelView(
        name=Channel.SET_POINT_TO_LOAD,
        rows=stack.recordings[0].joint_names,
        unit="N·m",
        response=np.zeros(shape),
        usable=np.repeat(stack.inner(stack.used)[::STRIDE, None], shape[1], axis=1),
        run=stack.run[::STRIDE],
        state=stack.state[::STRIDE],
        noise=np.ones(shape[1]),
        nuisance=np.zeros((*shape, 0)),
        row_joint=np.arange(shape[1], dtype=np.intp),
        row_leg=legs,
        leg_of_joint=legs,
        signals=signals,
        is_measured=False,
    )


def _impacts(stack: Stack) -> Flags:
    """States at which a joint rattles, or its foot touches down or lifts off, shape (N, J)."""
    hit = rattling(stack)
    legs = leg_of_joint(stack.recordings[0].joint_names, stack.recordings[0].foot_names)
    if all(r.has("foot_contact") for r in stack.recordings):
        contact = stack.cat(lambda r: r.foot_contact).astype(np.bool_)
        change = np.zeros_like(contact)
        change[1:] = contact[1:] != contact[:-1]
        reach = np.zeros((2 * BEFORE_FLAG + 1, 1), dtype=np.bool_)
        reach[: BEFORE_FLAG + AFTER_FLAG + 1] = True
        around = np.asarray(binary_dilation(change, reach))
        hit[:, legs >= 0] |= around[:, legs[legs >= 0]]
    return np.asarray(hit)


def _between_states(stack: Stack, lag_s: float) -> Array:
    """What a rotor takes of a set-point's step within the period in which it comes, as far as states cannot tell.

    A load is measured at the end of a period, when the step is in it or not yet; the mean acceleration over the period
    has the part of it since it came. What a rotor's inertia makes of the difference is a nuisance. Shape (N, J), N·m.
    """
    parts: list[Array] = []
    for recording in stack.recordings:
        out = np.zeros((len(recording), recording.n_joints))
        order = np.argsort(recording.command_ns, kind="stable")
        commands = recording.commands
        step = np.diff((commands.kp_nm_per_rad * commands.position_rad)[order], axis=0)
        state, later = recording.next_row(recording.command_ns[order][1:])
        inside = (recording.command_ns[order][1:] > recording.start_ns) & (state < len(recording)) & (later < 1.0)
        share = later[inside]
        seen = (share * recording.period_s >= lag_s).astype(np.float64)
        np.add.at(out, state[inside], (seen - share)[:, None] * np.nan_to_num(step[inside]))
        parts.append(out)
    return np.concatenate(parts)


def leg_of_joint(joint_names: Sequence[str], foot_names: Sequence[str]) -> Ints:
    """Leg of each joint by the joint's prefix, -1 where none fits; shape (J,)."""
    legs = {name: i for i, name in enumerate(foot_names)}
    return np.array([legs.get(name.split("_")[0], -1) for name in joint_names], dtype=np.intp)


def _at_lag(stack: Stack, lag_s: float) -> tuple[Array, Array, NDArray[np.intp]]:
    """Joint positions and velocities a lag before each state, and the rows of commands in effect then."""
    share = np.minimum(lag_s / stack.step_s(), 1.0)
    position, velocity = stack.filled(lambda r: r.position_rad), stack.filled(lambda r: r.velocity_rad_s)
    rows = np.concatenate([r.command_row(-lag_s) for r in stack.recordings])
    return _shifted(position, share), _shifted(velocity, share), rows


def _shifted(values: Array, share: Array) -> Array:
    """Values a share (n, 1) of the step before earlier, by the straight line between neighbours."""
    earlier = np.concatenate([values[:1], values[:-1]])
    return np.asarray(values + share * (earlier - values))


def _request(stack: Stack, position: Array, velocity: Array, rows: NDArray[np.intp]) -> Array:
    """The servo law for commands by row within each recording; 0 before the first."""

    def of(name: str) -> Array:
        return _commanded(stack, rows, name)

    asked = pd_torque(
        position_rad=position,
        velocity_rad_s=velocity,
        setpoint_position_rad=of("position_rad"),
        setpoint_velocity_rad_s=of("velocity_rad_s"),
        feedforward_nm=of("load_nm"),
        kp_nm_per_rad=of("kp_nm_per_rad"),
        kd_nm_s_per_rad=of("kd_nm_s_per_rad"),
    )
    return np.asarray(np.where((rows >= 0)[:, None], asked, 0.0))


def _commanded(stack: Stack, rows: NDArray[np.intp], name: str) -> Array:
    """A column of the commands by row within each recording; before the first as in the first. Shape (N, J)."""
    parts: list[Array] = [
        getattr(r.commands, name)[np.maximum(rows[stack.run == i], 0)] for i, r in enumerate(stack.recordings)
    ]
    return np.nan_to_num(np.concatenate(parts))


def _signals(stack: Stack, effects: Sequence[Effect], lag_s: float) -> ActuatorSignals:
    position, velocity, rows = _at_lag(stack, lag_s)
    request = _request(stack, position, velocity, rows)
    ages = _command_ages(stack, rows, lag_s)
    return ActuatorSignals(
        stack=stack,
        position_rad=position,
        velocity_rad_s=velocity,
        still_velocity_rad_s=stack.smooth(velocity),
        inertial_velocity_rad_s=_at_lag(stack, 0.5 * lag_s)[1],
        kd_nm_s_per_rad=np.where((rows >= 0)[:, None], _commanded(stack, rows, "kd_nm_s_per_rad"), 0.0),
        request_nm=request,
        torque_nm=nominal_torque_nm(effects, request, position, velocity, stack.run, stack.period_s),
        load_nm=stack.filled(lambda r: r.load_nm),
        command_age_s=ages,
        lag_s=lag_s,
        effects=tuple(effects),
    )


def _command_ages(stack: Stack, rows: NDArray[np.intp], lag_s: float) -> Array:
    """Age of the command in effect at each row. Shape (N,)."""
    ages = np.full(stack.n, np.inf)
    for number, recording in enumerate(stack.recordings):
        mine = stack.run == number
        row = rows[mine]
        known = row >= 0
        received = recording.command_ns[np.maximum(row, 0)]
        ages[mine] = np.where(known, (recording.stamp_ns - received) * 1e-9 - lag_s, np.inf)
    return ages


def _by_twelve(compute: Callable[..., Array], *columns: Array) -> Array:
    """Effects know twelve joints: those of another robot are computed by twelve, the last ones beside zeros."""
    n_joints, parts = columns[0].shape[1], []
    for first in range(0, n_joints, N_JOINTS):
        twelve = [c[:, first : first + N_JOINTS] for c in columns]
        size = twelve[0].shape[1]
        parts.append(compute(*(np.pad(c, ((0, 0), (0, N_JOINTS - size))) for c in twelve))[:, :size])
    return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
