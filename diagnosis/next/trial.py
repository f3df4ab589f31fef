"""One experiment on many simulated robots at once: whether they bear it, and what a run says of its robot in numbers.

A run's *signature* is the same for all runs of one experiment. Of each joint: what the servo law does not explain of
its load, projected on what losses and limits depend on, each in N·m root mean square; the load itself on acceleration;
how rough load and speed are, from state to state; how far it stays behind its set-point. Of the body: speed, attitude,
height. Of the link: how late commands act. The diagnosis looks at the same quantities in its channels.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from diagnosis.closed_loop.run_numbers import given_power_w
from diagnosis.closed_loop.simulation import SensorNoise, merged, simulate
from diagnosis.next.candidates import Motion
from diagnosis.read.segments import asked_torque_nm
from spot_log.read.run import Run
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.io.velocity_sequence import VelocitySequence
from spot_model.plant.closed_loop import StartState
from spot_model.policy.joint_script import joint_script
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.leg_kinematics import foot_position_in_body_m
from spot_model.robot.rotation import projected_gravity, rotate_inverse_wxyz, rotate_wxyz, tilt_rad
from trainer.signals.policy_ticks import Script

STATE_S: Final = facts.STATE_PERIOD_NS * 1e-9
STAND_S: Final = 1.0
"""Robots stand for so long before the motion begins; it is a part of the runs."""
TILT_RAD: Final = 0.6
"""The safety core stops at 0.785."""
HEIGHT_M: Final = 0.28
"""Body over its lowest sole; the safety core stops at 0.25 m."""
SPEED_RAD_S: Final = 25.0
"""Speed of a joint at which the knee's motor gives no more torque; the robot itself stops at 40."""
LOAD_NM: Final = np.tile([50.0, 50.0, 115.0], facts.N_LEGS)
"""The joints' limits are 45 and 113 N·m; the rest is noise of the cells."""
STOP_MARGIN_RAD: Final = 0.05
"""A joint measured this far beyond its stop was pressed against it."""


def try_on(
    motion: Motion,
    models: Sequence[RobotModel],
    policy: Policy | None,
    rng: np.random.Generator,
    tick_period_s: float | None = None,
) -> tuple[Run, ...]:
    """Runs of an experiment, one a robot, with every state of the stream; ``policy`` is for velocity sequences.

    ``rng`` draws sensors' noise and delays; ``tick_period_s`` is of the program that will run it, by default that of
    the policy's contract.

    Raises:
        BadInputError: A velocity sequence needs a policy, or asks for more than it knows, a joint experiment breaks its
            bounds, or the robots cannot be simulated side by side.
    """
    together = merged(models)
    if together is None:
        raise BadInputError("these robots cannot be simulated side by side: an effect has a number a run already")
    if isinstance(motion, VelocitySequence):
        if policy is None:
            raise BadInputError(f"experiment {motion.name} is a walk; give the policy with --policy")
        if motion.clipped(np.array(policy.command_low), np.array(policy.command_high)) != motion:
            raise BadInputError(
                f"experiment {motion.name} asks for more than the policy knows: V_x, V_y (m/s), ω_z (rad/s) from "
                f"{_numbers(policy.command_low)} to {_numbers(policy.command_high)}"
            )
        controller, rate_hz = policy, 1.0 / tick_period_s if tick_period_s else policy.contract.rate_hz
        asked = motion.sampled(rate_hz)
    else:
        controller = joint_script(motion)
        rate_hz = controller.contract.rate_hz
        asked = controller.motion.sampled(rate_hz)
    command = np.concatenate([np.zeros((round(STAND_S * rate_hz), asked.shape[1])), asked])
    still, joints = np.zeros(3), np.zeros(facts.N_JOINTS)
    start = StartState(
        facts.DEFAULT_POSITION_RAD, joints, np.array([1.0, 0.0, 0.0, 0.0]), still, still, joints.astype(np.float32)
    )
    scripts = [Script(motion.name, number, start, command, 1.0 / rate_hz) for number in range(len(models))]
    return tuple(simulate(together, controller, scripts, rng, SensorNoise()))


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{v:g}" for v in values)


def refusals(runs: Sequence[Run]) -> tuple[str, ...]:
    """Why an experiment must not be run, a sentence each; none where the robots of all runs bear it."""
    found: dict[str, list[tuple[float, str]]] = {}
    for run in runs:
        for words, value, joint in _wrong(run):
            found.setdefault(words, []).append((value, joint))
    out = []
    for words, cases in found.items():
        value, joint = max(cases, key=lambda case: abs(case[0]))
        out.append(f"{len(cases)} of {len(runs)} simulated robots {words.format(value, joint=joint)}")
    return tuple(out)


def _wrong(run: Run) -> Iterator[tuple[str, float, str]]:
    """What a run does wrong, by how much, and the joint, where it is one."""
    s = run.states
    rows = s.robot_stamp_ns >= s.robot_stamp_ns[0] + round(0.5 * STAND_S * 1e9)
    position, velocity, load = s.position_rad[rows], s.velocity_rad_s[rows], s.load_nm[rows]
    attitude = s.odom_from_body_wxyz[rows]
    if not all(np.isfinite(a).all() for a in (position, velocity, load, attitude)):
        yield "break their simulation", 0.0, ""
        return
    tilt = np.asarray(tilt_rad(attitude))
    feet = np.asarray(rotate_wxyz(attitude[:, None, :], np.asarray(foot_position_in_body_m(position))))
    height = facts.FOOT_RADIUS_M - feet[..., 2].min(axis=1)
    if tilt.max() > TILT_RAD:
        yield f"tip over or lean by {{:.2f}} rad (allowed: {TILT_RAD})", float(tilt.max()), ""
        return
    if height.min() < HEIGHT_M:
        yield f"sink to {{:.2f}} m (allowed: {HEIGHT_M} m)", float(height.min()), ""
    beyond = np.maximum(facts.POSITION_LOW_RAD - position, position - facts.POSITION_HIGH_RAD)
    for words, sizes, allowed in (
        (f"move {{joint}} at {{:.0f}} rad/s (allowed: {SPEED_RAD_S:g})", np.abs(velocity), SPEED_RAD_S),
        ("load {joint} with {:.0f} % of what it may carry", 100.0 * np.abs(load) / LOAD_NM, 100.0),
        (f"press {{joint}} {{:.2f}} rad into its stop (allowed: {STOP_MARGIN_RAD})", beyond, STOP_MARGIN_RAD),
    ):
        largest = sizes.max(axis=0)
        if largest.max() > allowed:
            yield words, float(largest.max()), facts.JOINT_NAMES[int(np.argmax(largest))]


def burden(runs: Sequence[Run]) -> str:
    """What an experiment loads on the robot, in words: the largest of all simulated robots."""
    knee = max(float(np.abs(r.states.load_nm[:, 2::3]).max()) for r in runs)
    speed = max(float(np.abs(r.states.velocity_rad_s).max()) for r in runs)
    work_j = max(given_power_w(r.states.load_nm, r.states.velocity_rad_s).sum() for r in runs) * STATE_S
    return f"knee up to {knee:.0f} N·m, joints up to {speed:.1f} rad/s, {work_j / 1e3:.1f} kJ of work"


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
    asked = asked_torque_nm(c, at, q, v)
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
