"""From logs and the nominal model to a verdict: where the gap lies, which effect causes it, how far it shrinks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from diagnosis.channels import Array, Channel
from diagnosis.channels.build import build_views
from diagnosis.channels.stack import stack
from diagnosis.closed_loop.environment import Surroundings
from diagnosis.closed_loop.gap_map import GapMap, Side, gap_map
from diagnosis.closed_loop.simulation import Rollouts, SensorNoise, rollouts_under, simulate
from diagnosis.closed_loop.trials import NOMINAL, Bench, Trials, measure_shrink, run_trials
from diagnosis.document import Shrink, Verdict
from diagnosis.library import LibraryEffect
from diagnosis.library.registry import LIBRARY
from diagnosis.selection.calibrated import calibrated
from diagnosis.selection.evidence import Board
from diagnosis.selection.normal_equations import one_thread
from diagnosis.selection.robot_models import by_joint, model_of
from diagnosis.verdict.assemble import assemble
from diagnosis.verdict.causes import CALIBRATED, Causes, decide
from diagnosis.verdict.evidence import Say, explain
from diagnosis.verdict.measured import (
    compared_models,
    measured_by_prediction,
    measured_by_simulation,
    with_environment,
)
from diagnosis.verdict.posterior_file import Posterior, posterior_of
from diagnosis.verdict.probability import unknown_beside
from spot_log.read.run import Run
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.text import counted
from trainer.signals.policy_ticks import scripts_of
from trainer.signals.recording import record
from trainer.simulate.engine import Tell

WITHOUT_RUNS = (
    "without the policy that ran on Spot nothing can be simulated: the map is that of open-loop prediction, and there "
    "is no shrink"
)


@dataclass(frozen=True)
class Diagnosis:
    """A verdict and what the report needs beside it."""

    verdict: Verdict
    corrected: RobotModel
    """The nominal model with this robot's ordinary errors, its ground, its estimator and the causes; plain numbers."""
    map: GapMap | None
    simulated: Mapping[str, tuple[Run, ...]]
    """Closed-loop runs, "nominal" and "corrected"; empty where nothing was simulated."""
    runs: tuple[Run, ...]
    board: Board
    causes: Causes
    posterior: Posterior | None = None
    """What is still possible, to simulate; None for a robot other than Spot."""


def diagnose(
    runs: Sequence[Run],
    nominal: RobotModel,
    policy: Policy | None,
    rng: np.random.Generator,
    say: Say,
    tell: Tell = lambda _: None,
    *,
    library: Mapping[str, LibraryEffect] = LIBRARY,
    with_synthesis: bool = False,
    nominal_name: str = "",
    limits_rad: tuple[Array, Array] | None = None,
    engine: Rollouts | None = None,
) -> Diagnosis:
    """Diagnose logs.

    Args:
        runs: Logs of one robot.
        nominal: The simulator's model.
        policy: The policy that ran; without it open-loop prediction decides what matters.
        rng: Draws noise of simulated sensors, permutations, resamples.
        say: Gets each step in words.
        tell: Gets the share of the present step that is done, 0 to 1.
        library: Effects that are tried.
        with_synthesis: As a check, also diagnose the nominal simulator with the effects added.
        nominal_name: For the verdict.
        limits_rad: Joint stops of a robot other than Spot, low and high.
        engine: Computes closed-loop runs; in this process by default.
    """
    say(f"building channels of {counted(len(runs), 'log')}")
    found = explain(runs, nominal, policy, library, say, limits_rad)
    is_spot = found.board.robot.joint_names == facts.JOINT_NAMES
    bench = Bench.of(runs, policy, engine or rollouts_under(policy)) if policy is not None and is_spot else None
    with one_thread():
        causes = decide(found, library)
        board = found.board
        best = calibrated(board, causes.best)
    corrected = by_joint(model_of(nominal, board, best), facts.JOINT_NAMES) if is_spot else nominal
    notes = [n for view in found.views.values() for n in view.notes]
    map_: GapMap | None = None
    shrink: Shrink | None = None
    trials: Trials | None = None
    simulated: dict[str, tuple[Run, ...]] = {}
    around = Surroundings()
    measured = measured_by_prediction(board, best)
    if bench is None:
        notes.append(WITHOUT_RUNS)
    else:
        say("simulating the models through the same commands")
        bench = with_environment(bench, board, best, nominal)
        models, like = compared_models(board, best, causes.stated)
        trials = run_trials(bench, nominal, board, models, like, rng, tell)
        around = bench.around(causes.stated).overall
        corrected = around.around(corrected)
        logs = stack([record(run) for run in trials.runs[NOMINAL]])
        views, _ = build_views(logs, nominal)
        map_ = gap_map(
            Side(found.stack, found.views.get(Channel.SET_POINT_TO_LOAD)),
            Side(logs, views.get(Channel.SET_POINT_TO_LOAD)),
            board.robot.leg_of_joint,
            rng,
        )
        shrink = measure_shrink(bench, trials, causes.stated, rng)
        measured = measured_by_simulation(bench, trials, best, causes.stated, rng) or measured
        simulated = {"nominal": tuple(trials.runs[NOMINAL]), "corrected": tuple(trials.runs.get(causes.stated, ()))}
        notes += [*trials.notes, *_about(bench, trials.is_crossed), *([map_.note] if map_.note else [])]
    unknown = unknown_beside(causes.first, bench, trials, CALIBRATED, causes.stated)
    distances = trials.distances() if trials is not None else {}
    verdict = assemble(causes, nominal, measured, unknown, distances, map_, shrink, notes, runs, nominal_name)
    verdict = verdict.model_copy(update={"without": tuple(n for n in LIBRARY if n not in library)})
    if with_synthesis and verdict.differences and policy is not None and is_spot:
        from diagnosis.verdict.diagnose import synthesis_check

        say("synthesis check")
        check = synthesis_check(runs, nominal, corrected, policy, verdict, rng, library)
        verdict = verdict.model_copy(update={"synthesis": check})
    posterior = posterior_of(causes, nominal, around, unknown, distances) if is_spot else None
    return Diagnosis(verdict, corrected, map_, simulated, tuple(runs), found.board, causes, posterior)


def _about(bench: Bench, is_crossed: bool) -> list[str]:
    notes = []
    if len(bench.sequences) == 1:
        notes.append(
            "one command sequence can be simulated: the shrink is measured with the model that was fitted to it"
        )
    elif not is_crossed:
        notes.append(
            "some command sequences are too short, or at other gains, to be simulated: the shrink is measured with the "
            "model that was fitted to all logs"
        )
    if all(len(own) < 2 for own in bench.real().values()):
        notes.append("no command sequence has two whole runs: the floor is the scatter of simulated runs")
    return notes


def synthesis_check(
    runs: Sequence[Run],
    nominal: RobotModel,
    corrected: RobotModel,
    policy: Policy,
    verdict: Verdict,
    rng: np.random.Generator,
    library: Mapping[str, LibraryEffect],
) -> dict[str, Any]:
    """Diagnose the corrected model's own logs.

    Returns:
        ``passed``: every effect found comes back, itself or by a member of its group, with at least half of its
        joints; ``found``: what came back.
    """
    logs = simulate(corrected, policy, scripts_of(runs), rng, SensorNoise())
    back = explain(logs, nominal, policy, library, lambda _: None)
    terms = back.selection.best.terms if back.selection.best is not None else ()
    robot = back.board.robot
    found = {t.effect.name: robot.named(robot.joints_of(t.effect, t.place)) for t in terms}
    passed = all(
        any(m in found and 2 * len(set(found[m]) & set(e.joints)) >= len(e.joints) for m in e.group)
        for e in verdict.differences
    )
    return {"passed": bool(passed and verdict.differences), "found": {k: list(v) for k, v in found.items()}}
