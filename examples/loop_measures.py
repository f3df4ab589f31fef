"""What the loop's table holds, read off the logs of one policy on one robot, and the walks that they come from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_log import Run
from spot_log.format.events import FOLLOWING_MODE
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint, sequence_of
from spot_model.robot import facts

Array = NDArray[np.float64]

SPEEDS_M_S: Final = (1.0, 2.0, 3.0, 3.5, 4.0, 4.5, 5.0, 5.5, 6.0, 6.5, 7.0)
HOLD_S: Final = 10.0
MEAN_OVER_S: Final = 5.0
KNEES: Final = slice(2, None, 3)
GRAVITY_M_S2: Final = 9.81
JUMPS: Final = 8
JUMP_S: Final = 1.5
SETTLED_S: Final = 1.0
LATERAL_M_S2: Final = 5.0
"""Largest speed times turn rate that is asked for."""


@dataclass(frozen=True)
class Step:
    """One speed of the stairs, held to its end."""

    commanded_m_s: float
    held_m_s: float
    """Mean over the last five seconds."""
    end: int
    """The tick after its last one, among those of the policy."""


@dataclass(frozen=True)
class Deployment:
    """How one policy did on one robot."""

    policy: str
    held_m_s: float
    """Highest mean speed over the last 5 s of a step of the stairs, held for 10 s, without a fall; 0 for none."""
    commanded_m_s: float
    """What was asked for on that step."""
    tracking_error_m_s: float
    """Mean absolute error of the forward speed over the forward sequence, as far as it went."""
    cost_of_transport: float
    """Positive mechanical work of the joints over weight and distance, in the forward sequence."""
    standing_m_s: float
    """Size of the mean forward speed over the last second of the forward sequence, when the command is zero."""
    turning_error_rad_s: float
    """Mean error of the turn rate over the last second of the random walks' commands, without those cut by a fall."""
    falls: int
    walks: int
    """Random ones with jumps of the command, in which falls were counted."""
    stairs_end: str
    """How the stairs ended: "completed", or why the run was stopped."""


def stairs(top_m_s: float) -> VelocitySequence:
    """Rising speeds up to the highest that a policy accepts, each held for ten seconds, 1 m/s² between them."""
    points = [Waypoint(time_s=0.0), Waypoint(time_s=1.0)]
    time_s, before = 1.0, 0.0
    for speed in [v for v in SPEEDS_M_S if v <= top_m_s]:
        time_s += speed - before
        points.append(Waypoint(time_s=time_s, v_x_m_s=speed, ramp=True))
        time_s, before = time_s + HOLD_S, speed
        points.append(Waypoint(time_s=time_s, v_x_m_s=speed, ramp=True))
    points.append(Waypoint(time_s=time_s + before / 2.0, ramp=True))
    return VelocitySequence(name="stairs", duration_s=points[-1].time_s + 0.5, waypoints=tuple(points))


def jumps(rng: np.random.Generator) -> VelocitySequence:
    """A new command every 1.5 s, without a ramp: up to 4.5 m/s ahead and 1 m/s back, sideways if slow, and turning."""
    points = []
    for i in range(JUMPS):
        forward = rng.uniform(-1.0, 4.5)
        side = rng.uniform(-1.0, 1.0) * (abs(forward) < 2.0)
        turn = rng.uniform(-1.0, 1.0) * min(1.5, LATERAL_M_S2 / max(abs(forward), 0.1))
        points.append((0.5 + JUMP_S * i, float(forward), float(side), float(turn)))
    return sequence_of("jumps", 1.0 + JUMP_S * JUMPS, (0.0,), *points)


def deployment(policy: str, climb: Run, forward: Run, walks: Sequence[Run]) -> Deployment:
    """One row of the table, from the logs of the stairs, the forward sequence and the random walks."""
    best = max(steps_of(climb), key=lambda step: step.held_m_s, default=Step(0.0, 0.0, 0))
    return Deployment(
        policy=policy,
        held_m_s=best.held_m_s,
        commanded_m_s=best.commanded_m_s,
        tracking_error_m_s=tracking_error(forward),
        cost_of_transport=cost_of_transport(forward),
        standing_m_s=standing_speed(forward),
        turning_error_rad_s=turning_error(walks),
        falls=sum(run.outcome != "completed" for run in walks),
        walks=len(walks),
        stairs_end=climb.outcome,
    )


def steps_of(run: Run) -> tuple[Step, ...]:
    """The stairs' steps that were held to their end."""
    command, speed, time_s = active(run)
    steps = []
    edges = np.flatnonzero(np.diff(command[:, 0])) + 1
    for start, end in pairwise([0, *edges.tolist(), len(command)]):
        wanted = round(float(command[start, 0]), 6)
        if wanted in SPEEDS_M_S and time_s[end - 1] - time_s[start] >= HOLD_S - 0.1:
            last = time_s[start:end] > time_s[end - 1] - MEAN_OVER_S
            steps.append(Step(wanted, float(speed[start:end][last].mean()), end))
    return tuple(steps)


def tracking_error(run: Run) -> float:
    """Mean absolute error of the forward speed."""
    command, speed, _ = active(run)
    return float(np.abs(speed - command[:, 0]).mean())


def standing_speed(run: Run) -> float:
    """Size of the mean forward speed over the last second, if the command is zero there; else NaN, after a fall."""
    command, speed, time_s = active(run)
    last = time_s > time_s[-1] - SETTLED_S
    return abs(float(speed[last].mean())) if not command[last].any() else float("nan")


def turning_error(walks: Sequence[Run]) -> float:
    """Mean over commands of |commanded − mean turn rate of the last second|; NaN without a whole command."""
    errors = []
    for run in walks:
        rows = run.ticks.mode == FOLLOWING_MODE
        command, rate = run.ticks.velocity_command[rows], run.ticks.observation[rows, 5].astype(np.float64)
        _, _, time_s = active(run)
        edges = np.flatnonzero(np.any(np.diff(command, axis=0) != 0.0, axis=1)) + 1
        for start, end in pairwise([0, *edges.tolist(), len(command)]):
            if time_s[end - 1] - time_s[start] >= JUMP_S - 0.1:
                last = time_s[start:end] > time_s[end - 1] - SETTLED_S
                errors.append(abs(float(rate[start:end][last].mean()) - float(command[start, 2])))
    return float(np.mean(errors)) if errors else float("nan")


def cost_of_transport(run: Run) -> float:
    """Positive mechanical work over weight and distance ahead, without a unit."""
    rows = active_states(run)
    power_w = np.maximum(run.states.load_nm[rows] * run.states.velocity_rad_s[rows], 0.0).sum(axis=1)
    _, speed, time_s = active(run)
    work_j = float(power_w.mean()) * time_s[-1]
    return work_j / (facts.TOTAL_MASS_KG * GRAVITY_M_S2 * float(speed.mean()) * time_s[-1])


def active(run: Run) -> tuple[Array, Array, Array]:
    """Velocity command, forward speed and time (from 0) of the policy's ticks."""
    rows = run.ticks.mode == FOLLOWING_MODE
    stamps = run.ticks.robot_stamp_ns[rows]
    return (
        run.ticks.velocity_command[rows],
        run.ticks.observation[rows, 0].astype(np.float64),
        (stamps - stamps[0]) * 1e-9,
    )


def active_states(run: Run, *, until: int | None = None, span_s: float | None = None) -> NDArray[np.bool_]:
    """States in which the policy was followed, as a mask; if asked, the last ``span_s`` of them before a tick's."""
    stamps = run.ticks.robot_stamp_ns[run.ticks.mode == FOLLOWING_MODE][:until]
    first = stamps[0] if span_s is None else stamps[-1] - round(span_s * 1e9)
    return np.asarray((run.states.robot_stamp_ns >= first) & (run.states.robot_stamp_ns <= stamps[-1]))
