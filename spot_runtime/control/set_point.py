"""Which set-point each mode asks for, and the hand-over between a held pose and the policy as a blend of servo laws.

The torque asked of each joint is the weighted sum of what the two laws would ask alone,

    τ = w·[k_h·(q_h − q) − d_h·q̇ + τ_h] + (1 − w)·[k_p·(q_p − q) − d_p·q̇],

and that is again one servo law, with gains w·k_h + (1 − w)·k_p and a set-point between the two. With w = 1 nothing
jumps when joint control begins: the set-point is the measured pose and the feed-forward torque the measured load.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from spot_model.robot import facts
from spot_model.robot.facts import NS_PER_S, Array
from spot_model.robot.state import Gains, RobotState
from spot_runtime.config import HandoverConfig
from spot_runtime.control.modes import TAKE_HOLD_S, Mode


class LoadAverage(NamedTuple):
    """The mean joint load over the newest states, so that one noisy sample does not become a feed-forward torque."""

    window_ns: int
    samples: tuple[tuple[int, Array], ...] = ()
    """Stamps and loads, oldest first."""

    @staticmethod
    def over(window_s: float) -> LoadAverage:
        """An average over so much robot time."""
        return LoadAverage(round(window_s * NS_PER_S))

    def after(self, states: Sequence[RobotState]) -> LoadAverage:
        """The average once these states have come, too; states older than the window fall out."""
        if not states:
            return self
        begin_ns = states[-1].robot_stamp_ns - self.window_ns
        samples = (*self.samples, *((state.robot_stamp_ns, state.load_nm) for state in states))
        return LoadAverage(self.window_ns, tuple(sample for sample in samples if sample[0] >= begin_ns))

    @property
    def is_full(self) -> bool:
        """Whether the samples span at least nine tenths of the window."""
        return bool(self.samples) and self.samples[-1][0] - self.samples[0][0] >= 0.9 * self.window_ns

    def mean_nm(self) -> Array:
        """Mean load, shape (12,), N·m. Raises ValueError: no state was taken yet."""
        if not self.samples:
            raise ValueError("no state to average over")
        return np.asarray(np.mean([load for _, load in self.samples], axis=0))


_NO_LOAD: Final = np.zeros(facts.N_JOINTS)
_NO_LOAD.flags.writeable = False

FIRST_STIFFNESS: Final = 0.1
"""Of the stand's: 62 and 94 N·m/rad at the hips and 29 at the knees. A knee that carries a quarter of the body on a
foot 0.28 m below it needs 22 N·m/rad not to give way."""


class Setpoint(NamedTuple):
    """All that a command asks of the twelve joints, apart from its key and times."""

    position_rad: Array
    """Shape (12,)."""
    load_nm: Array
    """Feed-forward torque, shape (12,)."""
    gains: Gains


def policy_setpoint(position_rad: Array, gains: Gains) -> Setpoint:
    """What the policy asks for: positions alone, no feed-forward."""
    return Setpoint(position_rad, _NO_LOAD, gains)


def hold_setpoint(position_rad: Array, load_nm: Array) -> Setpoint:
    """Hold a measured pose with the stand's gains and the load that carries the body. Both of shape (12,)."""
    return Setpoint(position_rad.copy(), load_nm.copy(), Gains.stand())


def taking_hold(hold: Setpoint, held_s: float) -> Setpoint:
    """The held pose, as stiff as it is so long after the robot confirmed joint control.

    The feed-forward torque carries the body, so stiffness can rise from a tenth by equal factors: a joint that is not
    where it is said to be shows in its load while little is asked of it. Where no load is reported, the whole stiffness
    carries the body from the beginning.
    """
    if not hold.load_nm.any():
        return hold
    share = FIRST_STIFFNESS ** min(1.0, max(0.0, 1.0 - held_s / TAKE_HOLD_S))
    return hold._replace(gains=Gains(share * hold.gains.kp_nm_per_rad, hold.gains.kd_nm_s_per_rad))


def damping_setpoint(position_rad: Array, kd_nm_s_per_rad: float) -> Setpoint:
    """No stiffness, only damping; the position has no effect."""
    zeros = np.zeros_like(position_rad)
    return Setpoint(position_rad, zeros, Gains(zeros, np.full_like(zeros, kd_nm_s_per_rad)))


def blend(hold: Setpoint, policy: Setpoint, hold_weight: float) -> Setpoint:
    """The servo law whose torque is the weighted sum of the two laws' torques.

    A weight of 1 gives ``hold``, and one of 0 gives ``policy``, unchanged.

    Raises:
        ValueError: The weight is outside [0, 1].
    """
    if not 0.0 <= hold_weight <= 1.0:
        raise ValueError(f"hold_weight = {hold_weight}; allowed: 0 to 1")
    if hold_weight == 1.0:
        return hold
    if hold_weight == 0.0:
        return policy
    kp_hold = hold_weight * hold.gains.kp_nm_per_rad
    kp_policy = (1.0 - hold_weight) * policy.gains.kp_nm_per_rad
    kp = kp_hold + kp_policy
    kd = hold_weight * hold.gains.kd_nm_s_per_rad + (1.0 - hold_weight) * policy.gains.kd_nm_s_per_rad
    position = (kp_hold * hold.position_rad + kp_policy * policy.position_rad) / kp
    load = hold_weight * hold.load_nm + (1.0 - hold_weight) * policy.load_nm
    return Setpoint(position, load, Gains(kp, kd))


def hold_weight_in(share: float) -> float:
    """Weight of the held pose after a share (0 to 1) of the ramp to the policy.

    Cubic: the stand is some ten times stiffer than the policy, so its weight must fall fast at first and gently where
    the two laws are of one size.
    """
    return (1.0 - min(1.0, max(0.0, share))) ** 3


def hold_weight_out(share: float) -> float:
    """Weight of the held pose after a share (0 to 1) of the ramp back: the way in, reversed."""
    return hold_weight_in(1.0 - share)


def within_stops(position_rad: Array) -> Array:
    """A measured pose as a set-point: sensors may read a little beyond a joint's stop. Shape (12,)."""
    return np.minimum(np.maximum(position_rad, facts.POSITION_LOW_RAD), facts.POSITION_HIGH_RAD)


def asked_setpoint(
    mode: Mode,
    in_mode_s: float,
    *,
    hold: Setpoint,
    policy_rad: Array | None,
    policy_gains: Gains,
    measured_rad: Array,
    config: HandoverConfig,
) -> Setpoint:
    """The set-point that a mode which sends asks for, before any limit; poses and set-points have shape (12,).

    ``in_mode_s`` is robot time since the mode began; since the robot confirmed joint control, while it takes hold.
    ``hold`` is the pose in which the vendor's stand handed over.

    Raises:
        ValueError: The mode runs the policy, but the policy's set-point is missing.
    """
    if mode is Mode.DAMPING:
        return damping_setpoint(within_stops(measured_rad), config.damping_kd_nm_s_per_rad)
    if mode is Mode.ACTIVATING:
        return taking_hold(hold, in_mode_s)
    if not mode.runs_policy:
        return hold
    if policy_rad is None:
        raise ValueError(f"mode {mode.value} needs the policy's set-point")
    weight = 0.0
    if mode is Mode.RAMPING_IN:
        weight = hold_weight_in(in_mode_s / config.ramp_in_s)
    elif mode is Mode.RAMPING_OUT:
        weight = hold_weight_out(in_mode_s / config.ramp_out_s)
    return blend(hold, policy_setpoint(policy_rad, policy_gains), weight)
