"""The stretch of a log under the policy: its ticks, when the robot falls, and the same run for a simulator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_log.format.events import FOLLOWING_MODE
from spot_log.read.run import Run, StateTable, TickTable
from spot_model.plant.closed_loop import StartState
from spot_model.policy.observation import observed
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.leg_kinematics import foot_position_in_body_m
from spot_model.robot.rotation import projected_gravity
from spot_model.robot.state import Measured
from spot_runtime.safety_limits import SafetyLimits
from trainer.signals.recording import Stamps

MIN_TICKS: Final = 50
"""A run of less than a second is no sample of a gait."""
TILT_RAD: Final = SafetyLimits().tilt_rad
"""A body that leans further falls."""
HEIGHT_M: Final = SafetyLimits().body_height_m
"""A body lower than this over its lowest sole has collapsed."""
AFTER_NS: Final = 100_000_000
"""The state that makes the runtime take the policy away may come this long after the policy's last tick: five ticks. A
robot that sits down, or is damped for another reason, sinks more slowly."""
SAMPLED_NS: Final = 15_000_000
"""A body that has collapsed stays down for longer: it is looked for in states so far apart."""


@dataclass(frozen=True)
class Script:
    """One run to make: how it starts and what it is told."""

    sequence: str
    repeat: int
    start: StartState
    velocity_command: NDArray[np.float64]
    """One a simulated policy tick, shape (n_ticks, 3): what was in force then, however the log's own ticks slipped."""
    tick_period_s: float = 1.0 / facts.POLICY_RATE_HZ
    """As the program meant it: one that counts states runs the policy at every sixth, and a gait shows it."""


def policy_ticks(run: Run, at_least: int = 0) -> NDArray[np.intp]:
    """Ticks in which the policy followed the command, before any fall; of a log without modes all that ran a policy.

    ``at_least`` so many are kept even of a robot that falls sooner.
    """
    rows, fall_ns = followed(run.ticks), fall_stamp_ns(run)
    if fall_ns is None:
        return rows
    return rows[: max(at_least, int(np.searchsorted(run.ticks.robot_stamp_ns[rows], fall_ns)))]


def fall_stamp_ns(run: Run) -> int | None:
    """Robot stamp of the first state in which the robot has fallen under the policy; None where it never did."""
    known = vars(run)  # kept with the run, which does not change: it is asked for some seven times
    if "fall_stamp_ns" not in known:
        s, ticks_ns = run.states, run.ticks.robot_stamp_ns[followed(run.ticks)]
        row = fall_row(run.header.joint_names, s, s.robot_stamp_ns, ticks_ns)
        known["fall_stamp_ns"] = int(s.robot_stamp_ns[row]) if row < len(s) else None
    stamp_ns: int | None = known["fall_stamp_ns"]
    return stamp_ns


def fall_row(joint_names: tuple[str, ...], states: StateTable | Measured, stamp_ns: Stamps, ticks_ns: Stamps) -> int:
    """First row of a log at which the robot has fallen while a policy ran; the number of rows where it never did.

    Args:
        joint_names: Of the log; the height of the body is known of Spot alone.
        states: With joint positions and attitudes, n rows.
        stamp_ns: Robot stamp of each row, shape (n,).
        ticks_ns: Those of the ticks in which the policy followed the command, shape (k,).
    """
    n = len(stamp_ns)
    if len(ticks_ns) == 0:
        return n
    first, last = np.searchsorted(stamp_ns, [ticks_ns[0], ticks_ns[-1] + AFTER_NS])
    gravity = np.asarray(projected_gravity(states.odom_from_body_wxyz[first:last]))
    with np.errstate(invalid="ignore"):
        is_down = gravity[:, 2] > -np.cos(TILT_RAD)
        if joint_names == facts.JOINT_NAMES and last > first:
            position = states.position_rad[first:last]
            every = max(1, SAMPLED_NS * (last - first) // int(stamp_ns[last - 1] - stamp_ns[first] + 1))
            if (_height_m(position[::every], gravity[::every]) < HEIGHT_M).any():
                is_down |= _height_m(position, gravity) < HEIGHT_M
    rows = np.flatnonzero(is_down)
    return int(first + rows[0]) if len(rows) else n


def _height_m(position_rad: Array, gravity_in_body: Array) -> Array:
    """Height of the body over its lowest sole, shape (n,)."""
    feet = np.asarray(foot_position_in_body_m(position_rad))
    return np.asarray((feet @ gravity_in_body[:, :, None])[..., 0].max(axis=1) + facts.FOOT_RADIUS_M)


def followed(t: TickTable) -> NDArray[np.intp]:
    """Ticks in which the policy followed the command, a fall or none; of a log without modes all that ran a policy."""
    if len(t) == 0:
        return np.zeros(0, dtype=np.intp)
    sound = np.isfinite(t.observation).all(axis=1) & np.isfinite(t.action).all(axis=1)
    is_active = sound & (t.mode == FOLLOWING_MODE)
    return np.flatnonzero(is_active if is_active.any() else sound)


def scripts_of(runs: Sequence[Run]) -> list[Script]:
    """Those of all runs that are long enough, with the tick period that most of them have.

    A run that fell is told what the longest run of its sequence was told from there on: a simulated robot may last.
    """
    period_s = tick_period_s(runs)
    made = [(script, fall_stamp_ns(run)) for run in runs if (script := script_of(run, period_s)) is not None]
    longest: dict[str, NDArray[np.float64]] = {}
    for script, _ in made:
        if len(script.velocity_command) > len(longest.get(script.sequence, ())):
            longest[script.sequence] = script.velocity_command
    out = []
    for script, fall_ns in made:
        own, whole = script.velocity_command, longest[script.sequence]
        told = own if fall_ns is None else np.concatenate([own, whole[len(own) :]])
        out.append(replace(script, velocity_command=told))
    return out


def tick_period_s(runs: Sequence[Run]) -> float:
    """How often the robot's program runs the policy, in the median of the runs; the policy's own rate where none says.

    From the numbers of the ticks, so that neither lost ones nor stamps of a coarse state stream count; to a
    millisecond, and no shorter than a state's period.
    """
    found = []
    for run in runs:
        rows = policy_ticks(run)
        if len(rows) < MIN_TICKS:
            continue
        numbers, stamps_ns = run.ticks.index[rows], run.ticks.robot_stamp_ns[rows]
        n_ticks = max(int(numbers[-1] - numbers[0]), len(rows) - 1 + int(run.ticks.skipped[rows[1:]].sum()))
        found.append(float(stamps_ns[-1] - stamps_ns[0]) * 1e-9 / n_ticks)
    if not found:
        return 1.0 / facts.POLICY_RATE_HZ
    return max(round(1e3 * float(np.median(found))) / 1e3, facts.STATE_PERIOD_NS * 1e-9)


def script_of(run: Run, period_s: float | None = None) -> Script | None:
    """The run as a simulator would start it, by default with its own tick period; None where it is too short."""
    rows = policy_ticks(run)
    if len(rows) < MIN_TICKS:
        return None
    t, start = run.ticks, start_of(run, int(rows[0]))
    period_s = period_s or tick_period_s([run])
    period_ns, logged = round(1e9 * period_s), t.robot_stamp_ns[rows] - t.robot_stamp_ns[rows[0]]
    even = np.arange(round(logged[-1] / period_ns) + 1) * period_ns
    # A logged tick counts from half a period before its stamp on: stamps are those of states, some late, some early.
    nearest = np.searchsorted(logged, even + period_ns // 2, side="right") - 1
    name, told = run.header.command_sequence or "unnamed", t.velocity_command[rows][nearest]
    return Script(name, run.header.repeat, start, told, period_s)


def start_of(run: Run, tick: int = 0) -> StartState:
    """The robot as one of the run's ticks saw it."""
    s, t = run.states, run.ticks
    at = min(int(np.searchsorted(s.robot_stamp_ns, t.robot_stamp_ns[tick])), len(s) - 1)
    return StartState(
        position_rad=s.position_rad[at],
        velocity_rad_s=s.velocity_rad_s[at],
        world_from_body_wxyz=s.odom_from_body_wxyz[at],
        linear_vel_of_body_in_world_m_s=s.linear_vel_of_body_in_odom_m_s[at],
        angular_vel_of_body_in_world_rad_s=s.angular_vel_of_body_in_odom_rad_s[at],
        last_action=np.asarray(observed(t.observation[tick], "last_action")),
    )
