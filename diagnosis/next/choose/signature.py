"""What a run says of its robot in a few numbers, the same for all runs of one experiment.

Of each joint: what the servo law does not explain of its load, projected on what losses and limits depend on, each in
N·m root mean square; the load itself on acceleration; how rough load and speed are, from state to state; how far it
stays behind its set-point. Of the body: speed, attitude, height. Of the link: how late commands act. The diagnosis
looks at the same quantities in its channels.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from diagnosis.next.choose.trial import STAND_S, STATE_S
from spot_log.read.run import Run
from spot_model.robot.control import pd_torque
from spot_model.robot.facts import Array
from spot_model.robot.leg_kinematics import foot_position_in_body_m
from spot_model.robot.rotation import projected_gravity, rotate_inverse_wxyz, rotate_wxyz

SOFT_RAD_S: Final = 0.1
SMOOTHED: Final = 5
"""States over which rates are taken."""
FORMULA_FLOOR: Final[dict[str, float]] = {
    "torque": 0.15,
    "rough load": 0.4,
    "rough speed": 0.03,
    "position": 0.003,
    "body": 0.02,
    "link": 0.5,
}
"""What formulas leave in each kind of number: N·m, N·m, rad/s, rad, m/s (or rad, m), ms; of what is rough as much as
sensors' usual noise. Not calibrated."""


def signature(run: Run) -> Array:
    """The numbers, in units of what formulas leave; not finite where the simulation broke."""
    s, c = run.states, run.commands
    begin_ns = s.robot_stamp_ns[0] + round(STAND_S * 1e9)
    rows = s.robot_stamp_ns >= begin_ns
    at = np.clip(s.last_command_key - 1, 0, len(c) - 1)[rows]
    q, v, load = s.position_rad[rows], s.velocity_rad_s[rows], s.load_nm[rows]
    asked = pd_torque(
        position_rad=q,
        velocity_rad_s=v,
        setpoint_position_rad=c.position_rad[at],
        setpoint_velocity_rad_s=c.velocity_rad_s[at],
        feedforward_nm=c.load_nm[at],
        kp_nm_per_rad=c.kp_nm_per_rad[at],
        kd_nm_s_per_rad=c.kd_nm_s_per_rad[at],
    )
    left = load - asked
    rate, change = _rate(v), _rate(asked)
    way = np.tanh(v / SOFT_RAD_S)
    drives = np.asarray(asked * v > 0.0, dtype=np.float64)
    high = np.maximum(np.abs(asked) - np.quantile(np.abs(asked), 0.8, axis=0), 0.0) * np.sign(asked)
    basis = (np.ones_like(q), way, v, np.abs(asked) * way, asked, asked * drives, high, rate, change, np.cos(q))
    torques = [_along(left, b) for b in basis] + [_along(load, b) for b in (np.ones_like(q), rate)]
    behind = [np.mean(c.position_rad[at] - q, axis=0), np.std(c.position_rad[at] - q, axis=0)]
    late_ms = _late_ms(run)
    parts = [
        np.concatenate(torques) / FORMULA_FLOOR["torque"],
        _roughness(load) / FORMULA_FLOOR["rough load"],
        _roughness(v) / FORMULA_FLOOR["rough speed"],
        np.concatenate(behind) / FORMULA_FLOOR["position"],
        _body(run, rows) / FORMULA_FLOOR["body"],
        np.array([late_ms.mean(), late_ms.std()]) / FORMULA_FLOOR["link"],
    ]
    return np.concatenate(parts)


def _along(values: Array, basis: Array) -> Array:
    """Root mean square of the part of each column along a basis, with its sign, shape (12,)."""
    size = np.sqrt(np.mean(basis**2, axis=0))
    return np.asarray(np.mean(values * basis, axis=0) / np.maximum(size, 1e-9))


def _roughness(values: Array) -> Array:
    """Standard deviation of white noise with the same second differences, shape (12,): knocks stand out of it."""
    return np.asarray(np.std(np.diff(values, n=2, axis=0), axis=0) / np.sqrt(6.0))


def _rate(values: Array) -> Array:
    kernel = np.ones(SMOOTHED) / SMOOTHED
    smooth = np.apply_along_axis(np.convolve, 0, values, kernel, mode="same")
    return np.asarray(np.gradient(smooth, STATE_S, axis=0))


def _body(run: Run, rows: np.ndarray) -> Array:
    s = run.states
    attitude, q = s.odom_from_body_wxyz[rows], s.position_rad[rows]
    velocity = np.asarray(rotate_inverse_wxyz(attitude, s.linear_vel_of_body_in_odom_m_s[rows]))
    turning = s.angular_vel_of_body_in_odom_rad_s[rows]
    down = np.asarray(projected_gravity(attitude))
    feet = np.asarray(rotate_wxyz(attitude[:, None, :], np.asarray(foot_position_in_body_m(q))))
    height = -feet[..., 2].min(axis=1)
    parts = np.array_split(np.arange(len(q)), 4)
    by_part = [velocity[p].mean(axis=0) for p in parts if len(p)]
    means = [velocity.std(axis=0), turning.std(axis=0), down[:, :2].mean(axis=0), down[:, :2].std(axis=0)]
    return np.concatenate([*by_part, *means, [height.mean(), height.std()]])


def _late_ms(run: Run) -> Array:
    """From when each command was sent until it was received, ms."""
    key, first = np.unique(run.states.last_command_key, return_index=True)
    known = (key > 0) & (key <= len(run.commands))
    sent = run.commands.robot_stamp_ns[key[known] - 1]
    late = 1e-6 * (run.states.last_command_robot_stamp_ns[first[known]] - sent)
    return np.asarray(late if len(late) else np.zeros(1), dtype=np.float64)
