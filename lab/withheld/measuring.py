"""What only the judge can measure: what a fault does to its robot, and how much a delivered model closes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_log import Run, read_run
from spot_log.format.events import FOLLOWING_MODE
from spot_model.effects.base import CommandEffect, SoftwareEffect
from spot_model.io.model_file import RobotModel
from spot_model.plant.closed_loop import put_at
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.policy.observation import is_fallen, observed
from spot_model.policy.policy import Policy
from spot_model.robot.facts import Array
from spot_model.robot.mjcf import MjcfOptions
from trainer.signals.distances import SequenceReference, features_of_observations, wasserstein_sorted
from trainer.signals.policy_ticks import start_of
from trainer.simulate.recorded_loop import Course, RecordedLoop
from trainer.sysid.logs import sequence_of_log
from withheld.outcome import GAPS, Change, Consequences, Gap
from withheld.plan import Reality, RecordingPlan

MIN_TICKS: Final = 50
"""A shorter walk is not compared."""
HELD_TICKS: Final = 50
"""A top speed was held for so many ticks, about 1 s."""
TWIN_REPEATS: Final = 3
"""Runs of each sequence by the robot without a fault; several, so that there is a floor even for a case of one run."""
SHRINK_REPEATS: Final = 3
"""Runs of each new sequence, real and simulated, for the true S."""
SMALLEST_GAP: Final = 0.25
"""In floors. A gap smaller than this above its floor cannot be shrunk by a share that means anything."""
STEP_S: Final = 1e-3
"""Physics step of a delivered model."""


# Walks ----------------------------------------------------------------------------------------------------------------


class Walk(NamedTuple):
    """One run at the policy's ticks, from when it was in command until any fall."""

    sequence: str
    features: NDArray[np.float32]
    """Features of the headline measure. Shape (n_ticks, 36), N·m."""
    signals: Mapping[Gap, Array]
    """Loads, N·m, and velocities of the joints, rad/s, each of shape (n_ticks, 12), and the body's in its own frame,
    m/s, shape (n_ticks, 3)."""
    is_fallen: bool
    """Whether the robot fell."""


def record_runs(reality: Reality, plan: RecordingPlan, folder: Path) -> list[Run]:
    """Have a reality record a plan into a folder, and read its logs in the order of sequences and repeats."""
    reality.record(plan, folder)
    runs = [read_run(path) for path in sorted(folder.glob("*.mcap"))]
    return sorted(runs, key=lambda run: (run.header.command_sequence, run.header.repeat))


def walk_of_run(run: Run, policy: Policy) -> Walk:
    """Return what is compared of a run with ticks."""
    ticks, states = run.ticks, run.states
    is_active = np.asarray(ticks.mode) == FOLLOWING_MODE
    is_whole = np.isfinite(ticks.observation).all(axis=1) & np.isfinite(ticks.action).all(axis=1)
    rows = np.flatnonzero(is_active & is_whole)
    fallen = np.flatnonzero(is_fallen(ticks.observation[rows]))
    rows = rows[: fallen[0]] if len(fallen) else rows
    at = np.clip(np.searchsorted(states.robot_stamp_ns, ticks.robot_stamp_ns[rows]), 0, len(states) - 1)
    seen = ticks.observation[rows].astype(np.float64)
    signals: dict[Gap, Array] = {
        "torque": states.load_nm[at],
        "joint motion": np.asarray(observed(seen, "joint_velocity_rad_s"))[:, policy.canonical_from_policy],
        "body motion": np.asarray(observed(seen, "linear_vel_of_body_in_body_m_s")),
    }
    features = features_of_observations(ticks.observation[rows], ticks.action[rows], policy)
    return Walk(run.header.command_sequence or "unnamed", features, signals, len(fallen) > 0)


Walks = Mapping[str, Sequence[Walk]]


def by_sequence(walks: Sequence[Walk]) -> dict[str, list[Walk]]:
    """Group walks that are long enough to be compared."""
    found: dict[str, list[Walk]] = {}
    for walk in walks:
        if len(walk.features) >= MIN_TICKS:
            found.setdefault(walk.sequence, []).append(walk)
    return found


# What a fault does ----------------------------------------------------------------------------------------------------


def moved(walks: Sequence[Walk], twins: Sequence[Walk]) -> float | None:
    """Return (D − floor)/floor: D the mean W1 + MMD between runs with and without a fault, floor that between repeats.

    None where a robot fell too soon.
    """
    first, second = by_sequence(walks), by_sequence(twins)
    ratios = []
    for name in sorted(first.keys() & second.keys()):
        repeated, others = first[name], second[name]
        if len(repeated) < len(others):
            repeated, others = others, repeated
        if len(repeated) > 1:
            ratios.append(_in_floors(name, repeated, others))
    return float(np.mean(ratios)) - 1.0 if ratios else None


def consequences(walks: Sequence[Walk], twins: Sequence[Walk]) -> Consequences:
    """Return changes from runs without a fault to runs with it, each measured up to a fall.

    Args:
        walks: Of the robot with the fault.
        twins: Of the same robot without it.
    """
    before, after = _figures(twins), _figures(walks)
    return Consequences(**{name: Change(before=before[name], after=after[name]) for name in before})


def _figures(walks: Sequence[Walk]) -> dict[str, float | None]:
    """Means over the runs of a sequence, then over sequences, of the top speed the largest; None without a long run."""
    own = np.array([np.mean([_figures_of(walk) for walk in runs], axis=0) for runs in by_sequence(walks).values()])
    top, mean, power = (own[:, 0].max(), *own[:, 1:].mean(axis=0)) if len(own) else (None, None, None)
    share = np.mean([walk.is_fallen for walk in walks]) if walks else None
    return {"top_speed": top, "mean_speed": mean, "power": power, "fall_share": share}


def _figures_of(walk: Walk) -> tuple[float, float, float]:
    """Top and mean forward speed, m/s, and mean positive power of the joints, W."""
    forward = walk.signals["body motion"][:, 0]
    held = np.convolve(forward, np.full(HELD_TICKS, 1.0 / HELD_TICKS), mode="valid")
    power = np.maximum(walk.signals["torque"] * walk.signals["joint motion"], 0.0).sum(axis=1)
    return float(held.max()), float(forward.mean()), float(power.mean())


# What a delivered model closes ----------------------------------------------------------------------------------------


class Shrunk(NamedTuple):
    """S = (D0 − D1)/(D0 − floor) of a delivered model, on runs that neither fit nor verdict saw."""

    s: float | None = None
    """S of the headline measure; None where the nominal model has no gap to speak of, or a robot falls."""
    gaps: Mapping[Gap, float] = {}
    """S of each of the three gaps that the nominal model has."""


def true_shrink(runs: Sequence[Run], nominal: RobotModel, delivered: RobotModel, policy: Policy, seed: int) -> Shrunk:
    """Measure how much a delivered model closes.

    Args:
        runs: New logs of the reality, several of each sequence.
        nominal: The model that the diagnosis was given.
        delivered: The model that it wrote.
        policy: In the loop.
        seed: Of the simulated runs.
    """
    real = {name: own for name, own in by_sequence([walk_of_run(run, policy) for run in runs]).items() if len(own) > 1}
    before, after = (
        by_sequence(simulate(model, policy, runs, np.random.default_rng(seed))) for model in (nominal, delivered)
    )
    gaps = {gap: _shrunk(real, before, after, partial(_w1, gap)) for gap in GAPS}
    return Shrunk(_shrunk(real, before, after, _in_floors), {gap: s for gap, s in gaps.items() if s is not None})


def simulate(model: RobotModel, policy: Policy, runs: Sequence[Run], rng: np.random.Generator) -> list[Walk]:
    """Run a model from where each run started, and tell it what that run was told.

    Whether a robot at rest goes on standing or marches on the spot hangs on how the policy took over, and its gait a
    minute later on which of the two it did: runs compare only from the same start.

    Args:
        model: All of its effects act.
        policy: In the loop.
        runs: Logs with states and ticks.
        rng: Draws what effects draw.

    Raises:
        BadInputError: The model cannot be simulated.
    """
    # Of the ticks, those alone at which the policy followed its command.
    followed = [replace(run, ticks=run.ticks.rows(np.flatnonzero(run.ticks.mode == FOLLOWING_MODE))) for run in runs]
    # To a millisecond: programs run the policy at 50 Hz or at every sixth state, and some ticks slip.
    stamps_ns = [run.ticks.robot_stamp_ns for run in followed]
    periods_s = [round(1e3 * float(ns[-1] - ns[0]) * 1e-9 / (len(ns) - 1)) * 1e-3 for ns in stamps_ns]
    channel = [e for e in model.effects if isinstance(e, CommandEffect)]
    software = [e for e in model.effects if isinstance(e, SoftwareEffect)]
    own = [e for e in model.effects if not isinstance(e, (CommandEffect, SoftwareEffect))]
    mjcf = MjcfOptions(timestep_s=STEP_S, cone="elliptic", collision="all", link_torque_sensors=True, visuals=False)
    plant = Plant(own, len(runs), PlantOptions(mjcf=mjcf, n_threads=1, on_divergence="flag"))
    last_action = put_at(plant, [start_of(run) for run in followed])
    loop = RecordedLoop(
        plant,
        policy,
        [Course(sequence_of_log(run), run.header.repeat, np.asarray(run.ticks.velocity_command)) for run in followed],
        start_setpoint_rad=np.asarray(policy.setpoint_rad(last_action)),
        last_action=last_action,
        channel=channel,
        rng=rng,
        software=software,
        only_ticks=True,
        tick_period_s=float(np.median(periods_s)),
    )
    return [walk_of_run(run, policy) for run in loop.runs()]


def _shrunk(
    real: Walks, before: Walks, after: Walks, apart: Callable[[str, Sequence[Walk], Sequence[Walk]], float]
) -> float | None:
    """(D0 − D1)/(D0 − floor), each the mean over the sequences; None without a gap, or where a robot falls."""
    if not real or not real.keys() <= before.keys() & after.keys():
        return None
    d0, d1, floor = (
        float(np.mean([apart(name, own, made[name]) for name, own in real.items()])) for made in (before, after, real)
    )
    return None if d0 < (1.0 + SMALLEST_GAP) * floor else (d0 - d1) / (d0 - floor)


def _in_floors(name: str, repeated: Sequence[Walk], others: Sequence[Walk]) -> float:
    """Mean W1 + MMD over that between repeats; 1 between the repeats themselves."""
    if others is repeated:
        return 1.0
    reference = SequenceReference.build(name, [walk.features for walk in repeated])
    return float(np.mean([reference.distances(walk.features) / reference.scale for walk in others]))


def _w1(gap: Gap, _: str, repeated: Sequence[Walk], others: Sequence[Walk]) -> float:
    """Mean Wasserstein distance over pairs of different runs and over a signal's components, in its unit."""
    first, second = (
        [np.sort(np.ascontiguousarray(walk.signals[gap].T), axis=-1) for walk in walks] for walks in (repeated, others)
    )
    return float(
        np.mean(
            [
                wasserstein_sorted(a, b)
                for a, x in zip(first, repeated, strict=True)
                for b, y in zip(second, others, strict=True)
                if x is not y
            ]
        )
    )
