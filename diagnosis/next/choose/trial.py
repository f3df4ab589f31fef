"""One experiment on many simulated robots at once, and whether they bear it: what is refused, and why."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from diagnosis.closed_loop.merged_models import merged
from diagnosis.closed_loop.run_numbers import given_power_w
from diagnosis.closed_loop.simulation import SensorNoise, simulate
from diagnosis.next.choose.candidates import Motion
from spot_log.read.run import Run
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.io.velocity_sequence import VelocitySequence
from spot_model.plant.start import StartState
from spot_model.policy.joint_script import joint_script
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.leg_kinematics import foot_position_in_body_m
from spot_model.robot.rotation import rotate_wxyz, tilt_rad
from trainer.signals.policy_ticks import Script

STATE_S: Final = facts.STATE_PERIOD_NS * 1e-9
STAND_S: Final = 1.0
"""Robots stand for so long before the motion begins; it is a part of the runs."""
TILT_RAD: Final = 0.6
"""The safety core stops at 0.785."""
HEIGHT_M: Final = 0.28
"""Body over its lowest sole; the safety core stops at 0.25 m."""
SPEED_RAD_S: Final = 25.0
"""Of a joint, where the knee's motor gives no more torque; the robot itself stops at 40."""
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
