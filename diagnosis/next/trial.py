"""The gate: whether simulated robots bear a recording; what the logs hold already, the robot bears.

It is simulated on robots that the logs allow, with ordinary errors of twice the published ranges beside: what one of
them does not bear is refused, with the reason.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from diagnosis.closed_loop.simulation import SensorNoise, simulate
from diagnosis.next.candidates import Motion
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.robot_models import with_errors
from spot_log.format.events import FOLLOWING_MODE
from spot_log.read.run import Run, StateTable
from spot_model.effects.side_by_side import compact, side_by_side
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.io.velocity_sequence import VelocitySequence
from spot_model.plant.closed_loop import StartState
from spot_model.policy.joint_script import joint_script
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.leg_kinematics import foot_position_in_body_m
from spot_model.robot.rotation import rotate_wxyz, tilt_rad
from trainer.signals.policy_ticks import Script, fall_stamp_ns

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
WIDE: Final = 2.0
"""Share of the published range of ordinary errors that the robots of the gate are drawn from."""
ROBOTS: Final = 50
WITHIN: Final = 0.02
"""Commands (m/s, rad/s) and set-points (rad) that differ by less are the same."""
SLIPS: Final = 1.1
"""Ticks slip: commands of a log may have come so many times as fast."""


def try_on(
    motion: Motion, models: Sequence[RobotModel], policy: Policy | None, seed: int, rate_hz: float | None = None
) -> tuple[Run, ...]:
    """Runs of a recording, one a robot, with every state of the stream; ``policy`` is for velocity sequences.

    ``seed`` is of noise and delays; ``rate_hz`` of the program that will run a walk, by default the policy's own.

    Raises:
        BadInputError: A walk has no policy, or asks for more than it knows, or a joint experiment breaks its bounds.
    """
    if not isinstance(motion, VelocitySequence):
        controller: Policy = (script := joint_script(motion))
        rate_hz = script.contract.rate_hz
        asked = script.motion.sampled(rate_hz)
    elif policy is None:
        raise BadInputError(f"recording {motion.name} is a walk; give the policy with --policy")
    elif motion.clipped(np.array(policy.command_low), np.array(policy.command_high)) != motion:
        low, high = (", ".join(f"{v:g}" for v in side) for side in (policy.command_low, policy.command_high))
        raise BadInputError(
            f"recording {motion.name} asks for more than the policy knows: V_x, V_y (m/s), ω_z (rad/s) from {low} to "
            f"{high}"
        )
    else:
        controller, rate_hz = policy, rate_hz or policy.contract.rate_hz
        asked = motion.sampled(rate_hz)
    command = np.concatenate([np.zeros((round(STAND_S * rate_hz), asked.shape[1])), asked])
    still, joints = np.zeros(3), np.zeros(facts.N_JOINTS)
    level = np.array([1.0, 0.0, 0.0, 0.0])
    start = StartState(facts.DEFAULT_POSITION_RAD, joints, level, still, still, joints.astype(np.float32))
    scripts = [Script(motion.name, i, start, command, 1.0 / rate_hz) for i in range(len(models))]
    together = RobotModel(side_by_side([compact(m.effects) for m in models], len(models)), models[0].robot)
    return tuple(simulate(together, controller, scripts, np.random.default_rng(seed), SensorNoise()))


def wide_robots(robots: Sequence[RobotModel], board: Evidence, rng: np.random.Generator) -> list[RobotModel]:
    """Robots that the logs allow, with wide errors of every ordinary kind that the logs show."""
    chosen = rng.integers(len(robots), size=ROBOTS)
    return [with_errors(robots[i], board, WIDE * rng.standard_normal(board.ordinary.size)) for i in chosen]


def refusals(runs: Sequence[Run]) -> tuple[str, ...]:
    """Why a recording must not be run, a sentence each; none where the robots of all runs bear it."""
    found: dict[str, list[tuple[float, str]]] = {}
    for words, value, joint in (wrong for run in runs for wrong in _wrong(run)):
        found.setdefault(words, []).append((value, joint))
    worst = {words: max(cases, key=lambda case: abs(case[0])) for words, cases in found.items()}
    return tuple(
        f"{len(found[words])} of {len(runs)} simulated robots {words.format(value, joint=joint)}"
        for words, (value, joint) in worst.items()
    )


def settled(run: Run) -> StateTable:
    """States of a simulated robot once it has come down on its feet."""
    s = run.states
    return s.rows(s.robot_stamp_ns >= s.robot_stamp_ns[0] + round(0.5 * STAND_S * 1e9))


def _wrong(run: Run) -> Iterator[tuple[str, float, str]]:
    """What a run does wrong, by how much, and the joint, where it is one."""
    s = settled(run)
    position, velocity, load, attitude = s.position_rad, s.velocity_rad_s, s.load_nm, s.odom_from_body_wxyz
    if not all(np.isfinite(a).all() for a in (position, velocity, load, attitude)):
        yield "break their simulation", 0.0, ""
        return
    tilt = float(np.max(tilt_rad(attitude)))
    feet = np.asarray(rotate_wxyz(attitude[:, None, :], np.asarray(foot_position_in_body_m(position))))
    height = float((facts.FOOT_RADIUS_M - feet[..., 2].min(axis=1)).min())
    if tilt > TILT_RAD:
        yield f"tip over or lean by {{:.2f}} rad (allowed: {TILT_RAD})", tilt, ""
        return
    if height < HEIGHT_M:
        yield f"sink to {{:.2f}} m (allowed: {HEIGHT_M} m)", height, ""
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
    """What a recording loads on the robot, in words: the largest of all simulated robots."""
    states = [settled(run) for run in runs]
    knee = max(float(np.abs(s.load_nm[:, 2::3]).max()) for s in states)
    speed = max(float(np.abs(s.velocity_rad_s).max()) for s in states)
    return f"knees with up to {knee:.0f} N·m, joints at up to {speed:.1f} rad/s"


def is_held(run: Run, logs: Sequence[Run]) -> bool:
    """Whether one of the logs, in which the robot did not fall, holds all that a simulated run asks for.

    For each command of the run the log has one that is at least as large in every direction, and within no second do
    the run's commands change by more than the log's.
    """
    is_walk, asked, changed = _asked(run)
    for log in logs:
        of_walk, had, had_changed = _asked(log)
        if of_walk != is_walk or np.any(changed > SLIPS * had_changed + WITHIN) or fall_stamp_ns(log) is not None:
            continue
        if all((np.sign(own) * had >= np.abs(own) - WITHIN).all(axis=1).any() for own in asked):
            return True
    return False


def _asked(run: Run) -> tuple[bool, Array, Array]:
    """Whether a policy walked; commands or set-points about the stand, each once; and how much they changed in 1 s."""
    ticks, rows = run.ticks, np.flatnonzero(run.ticks.mode == FOLLOWING_MODE)
    is_walk = bool(np.isfinite(ticks.action[rows]).all(axis=1).any())
    sent = np.isin(run.commands.key, ticks.command_key[rows])
    stand = run.commands.requested_position_rad[sent] - facts.DEFAULT_POSITION_RAD
    asked = np.concatenate(
        [np.zeros((1, 3 if is_walk else facts.N_JOINTS)), ticks.velocity_command[rows] if is_walk else stand]
    )
    way = np.cumsum(np.abs(np.diff(asked, axis=0, prepend=asked[:1])), axis=0)
    second = min(round(facts.POLICY_RATE_HZ), len(way) - 1)
    return is_walk, np.unique(asked.round(2), axis=0), (way[second:] - way[: len(way) - second]).max(axis=0)
