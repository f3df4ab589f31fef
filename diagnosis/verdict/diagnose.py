"""From logs and the nominal model to a verdict: where the gap lies, which effect causes it, how far it shrinks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.channels import Channel
from diagnosis.channels.actuator import actuator_view
from diagnosis.channels.stack import stacked
from diagnosis.closed_loop.environment import Surroundings
from diagnosis.closed_loop.gap_map import GapSide, gap_map
from diagnosis.closed_loop.simulation import RolloutEngine, rollouts_under
from diagnosis.closed_loop.trials import NOMINAL, Bench, measure_shrink, run_trials
from diagnosis.document import GapCell, Verdict
from diagnosis.library import LibraryEffect
from diagnosis.library.registry import LIBRARY
from diagnosis.library.repairs import with_repairs
from diagnosis.read.robot_file import SPOT, RobotFile
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.ordinary_errors import UNLIKE_MOTION
from diagnosis.selection.robot_models import corrected_model, effects_merged, model_by_joint
from diagnosis.selection.scoring import crossed
from diagnosis.selection.search import Say
from diagnosis.verdict.assemble import assemble
from diagnosis.verdict.belief import Belief, decide
from diagnosis.verdict.explanation import weigh
from diagnosis.verdict.left_over import left_over
from diagnosis.verdict.measured import compared_models, measured_by_prediction, measured_by_simulation, open_loop_cells
from diagnosis.verdict.possible_robots import possible_robots
from diagnosis.verdict.unknown import gaps_left
from spot_log.read.run import Run
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.text import counted
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
    cells: tuple[GapCell, ...]
    """Cells of the gap map in closed loop; empty where nothing was simulated."""
    simulated: Mapping[str, tuple[Run, ...]]
    """Closed-loop runs, "nominal" and "corrected"; empty where nothing was simulated."""
    runs: tuple[Run, ...]
    board: Evidence
    belief: Belief
    possible: tuple[RobotModel, ...] = ()
    """Robots drawn from what is still possible; none of a robot other than Spot."""


def diagnose_runs(
    runs: Sequence[Run],
    nominal: RobotModel,
    policy: Policy | None,
    rng: np.random.Generator,
    say: Say,
    tell: Tell = lambda _: None,
    *,
    library: Mapping[str, LibraryEffect] = LIBRARY,
    nominal_name: str = "",
    robot: RobotFile = SPOT,
    engine: RolloutEngine | None = None,
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
        nominal_name: For the verdict.
        robot: That the logs are of.
        engine: Computes closed-loop runs; in this process by default.
    """
    library = with_repairs(library, nominal)
    if robot.is_from_motion:
        library = {name: entry for name, entry in library.items() if name not in UNLIKE_MOTION}
    say(f"building channels of {counted(len(runs), 'log')}")
    found = weigh(runs, nominal, policy, library, say, robot)
    # What is there, and how this robot is calibrated.
    belief, board = decide(found, library), found.board
    best = crossed(board, belief.best)
    board.forget()
    is_spot = board.robot.joint_names == facts.JOINT_NAMES
    corrected = (
        model_by_joint(effects_merged(corrected_model(nominal, board, best)), facts.JOINT_NAMES) if is_spot else nominal
    )
    # What it does.
    bench = Bench.of(runs, policy, engine or rollouts_under(policy)) if policy is not None and is_spot else None
    measured, shrink, trials, around = measured_by_prediction(board, best), None, None, Surroundings()
    notes = [n for view in found.views.values() for n in view.notes]
    cells: tuple[GapCell, ...] = ()
    simulated: dict[str, tuple[Run, ...]] = {}
    if bench is None:
        notes.append(WITHOUT_RUNS)
    else:
        say("simulating the models through the same commands")
        models = compared_models(board, best, belief.stated)
        trials = run_trials(bench, nominal, board, models, belief.stated, rng, tell)
        say("weighing what was found")
        around = trials.surroundings.overall
        corrected = around.around(corrected)
        logs = stacked([record(run) for run in trials.runs[NOMINAL]])
        real = GapSide(found.stack, found.views.get(Channel.SET_POINT_TO_LOAD))
        made = GapSide(logs, actuator_view(logs, nominal.effects))
        cells, about_cells = gap_map(real, made, board.robot.leg_of_joint, rng)
        shrink = measure_shrink(trials, belief.stated, rng)
        measured = measured_by_simulation(trials, best, belief.stated, rng) or measured
        simulated = {"nominal": tuple(trials.runs[NOMINAL]), "corrected": tuple(trials.runs.get(belief.stated, ()))}
        notes += filter(None, [*trials.notes, *_about(bench, trials.is_crossed), about_cells])
    verdict = assemble(
        belief,
        nominal,
        measured,
        left_over(board, belief.best) | gaps_left(measured),
        trials,
        cells if trials is not None else open_loop_cells(found),
        shrink=shrink,
        without=tuple(n for n in LIBRARY if n not in library),
        logs=tuple(str(run.path) for run in runs),
        nominal=nominal_name,
        notes=tuple(dict.fromkeys(notes)),
    )
    robots = possible_robots(belief, nominal, around, rng) if is_spot else ()
    return Diagnosis(verdict, corrected, cells, simulated, tuple(runs), board, belief, robots)


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
        notes.append("no command sequence has two whole runs: what repeats explain is taken from simulated runs")
    return notes
