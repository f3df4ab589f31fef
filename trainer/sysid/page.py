"""The identification as one page for people: what was identified beside what was not, and robot beside simulation."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from spot_log.page.charts import liveliest
from spot_log.page.render import rendered
from spot_log.page.sections import Beside, Chart, Content, Fold, Head, Items, Legend, Mark, Section, Series, Table
from spot_model.robot import facts
from spot_model.robot.arrays import on_host
from spot_model.text import counted, parameter_words
from trainer.sysid.identify import Identification
from trainer.sysid.logs import sequence_of_log
from trainer.sysid.result import ResultData
from trainer.sysid.verdict import ParameterVerdict

OVERLAY_JOINTS: Final = ("fr_kn", "hr_kn")
"""Joints of the overlay: front and hind right knee, as in the paper's comparison figure."""
OVERLAY_S: Final = 3.0
"""Length of the stretch that the overlay shows."""
RUNS: Final = (("var(--real)", "robot"), ("var(--nominal)", "simulation, before"), ("var(--corrected)", "identified"))
NEAR: Final = 1.2
"""Distances of two real runs up to which the simulated runs count as near to the robot's."""

Traces = Sequence[tuple[NDArray[Any], NDArray[Any]]]
"""Action and torque, each of shape (ticks, 12), of robot, initial and identified simulation."""
Overlay = tuple[str, slice, float, Traces]
"""Command sequence, a stretch of its ticks, their rate in Hz, and traces."""


def identification_page(data: ResultData, overlays: Iterable[Overlay] = ()) -> str:
    """The page's text."""
    known = [p for p in data.parameters if p.identified]
    unknown = [p for p in data.parameters if not p.identified]
    held = "For these, the model file holds values that the logs do not contradict."
    searched = "Distance between simulated and real runs for the best model of each generation; less is closer."
    searched += " 1 is the distance between two real runs." if data.score_is_over_floor else ""
    nothing = "Nothing; the other box gives the reasons."
    rows = [(_plain(p.name), f"{p.value:.4g} {p.unit}", f"{p.low:.4g} to {p.high:.4g}", p.source) for p in known]
    values = Table(("parameter", "value", "90 % interval", "from"), rows)
    parts = [
        _head(data, known),
        Beside(
            [Section("Identified", "", values if rows else nothing), Section("Not identified", held, _reasons(unknown))]
        ),
        Section("Measured directly", "Measured from the logs, without a search.", _measured(data)),
        *(_overlay(*overlay) for overlay in overlays),
        Section("Search", searched, _score(data)),
        Section("Details", "", _details(data)),
    ]
    return rendered("Identification", parts)


def _head(data: ResultData, known: Sequence[ParameterVerdict]) -> Head:
    end = data.score.get("identified")
    badge, kind = ("Identified", "good") if len(known) == len(data.parameters) else ("In part", "fair")
    if not known:
        badge, kind = "Not identified", "bad"
    are = "is" if len(known) == 1 else "are"
    headline = f"{len(known)} of {counted(len(data.parameters), 'parameter')} {are} identified"
    told = [f"{counted(len(data.logs), 'log')} of {counted(len(data.sequences), 'command sequence')}."]
    if end is not None and data.score_is_over_floor:
        start = data.score.get("initial")
        before = "" if start is None else f", {start:.2f} before"
        near = "as close to the robot as another real run, or nearly"
        near = near if end <= NEAR else "still farther from the robot than a real run"
        told.append(f"Simulated runs are {near}: {end:.2f} times the distance of two real runs{before}.")
    elif not data.score_is_over_floor:
        told.append(
            "Record each sequence at least twice. Without repeats, it is not known how close the simulation is."
        )
    return Head(badge, kind, headline, told)


def _reasons(parameters: Sequence[ParameterVerdict]) -> Content:
    by_reason: dict[str, list[str]] = {}
    for p in parameters:
        by_reason.setdefault(p.reason, []).append(_plain(p.name))
    items = [(Mark("; ".join(names)), f": {why}") for why, names in by_reason.items()]
    return Items(items) if items else "Every parameter is identified."


def _measured(data: ResultData) -> Items:
    """What was measured; times in milliseconds."""
    told = ((m, f"{1e3 * m.value:.3g} ms" if m.unit == "s" else f"{m.value:.4g} {m.unit}") for m in data.measured)
    return Items((f"{m.what}: ", Mark(amount), f" ({m.source})") for m, amount in told)


def _score(data: ResultData) -> Content:
    best = np.array([np.nan if v is None else v for v in data.score_by_generation])
    if np.isfinite(best).sum() < 2:
        return None
    x = np.arange(1, len(best) + 1)
    lines = [
        Series("var(--other)", x, best, width=0.0, has_points=True, name="score"),
        Series("var(--corrected)", x, np.fmin.accumulate(best), width=2.0),
        *([Series("var(--floor)", x, np.ones(len(x)), is_dotted=True)] if data.score_is_over_floor else []),
    ]
    names = ("best of the generation", "best so far", "two real runs")
    key = Legend((line.colour, name) for line, name in zip(lines, names, strict=False))
    return [key, Chart(lines, "score", x_title="generation", height=150)]


def _details(data: ResultData) -> list[Fold]:
    rows = [
        (
            _plain(p.name),
            p.initial,
            f"{p.value:.4g} {p.unit}",
            f"{p.low:.4g} to {p.high:.4g}",
            f"{p.by_search.value:.4g} ({p.by_search.low:.4g} to {p.by_search.high:.4g})",
        )
        for p in data.parameters
    ]
    head = ("parameter", "initial", "value", "90 % interval", "by the search alone")
    runs = [(s.name, s.repeats, s.floor_w1_nm, s.floor_mmd) for s in data.sequences]
    runs_head = ("sequence", "repeats", "Wasserstein distance of two real runs, N·m", "MMD")
    return [
        Fold("Every parameter", Table(head, rows)),
        Fold("Command sequences, and how far two real runs differ", Table(runs_head, runs)),
        Fold("Logs", Items(data.logs)),
        Fold("What was cut or left out", Items(data.warnings)),
    ]


def _plain(name: str) -> str:
    """``coulomb_friction[hips].level_nm`` as words; the unit stands beside the value."""
    effect, _, parameter = name.partition("].")
    told = f"{effect.replace('[', ', ')}: {parameter_words(parameter)}" if parameter else name
    return told.replace("_", " ")


def overlays_of(found: Identification) -> Iterator[Overlay]:
    """For each sequence, action and torque: the robot, and simulations before and after."""
    problem = found.preparation.problem
    space = problem.space
    chosen = space.within_bounds(np.array([v.value for v in found.verdicts]))
    rollouts = problem.simulate(np.stack([space.initial, chosen]))
    case, rate_hz = 0, problem.policy.contract.rate_hz
    scale = problem.policy.contract.action_scale_rad * facts.POLICY_KP_NM_PER_RAD
    for reference, cases in zip(problem.references, problem.cases, strict=True):
        run = next(r for r in found.preparation.logs.compared if sequence_of_log(r) == reference.sequence)
        stretch = liveliest(np.linalg.norm(run.ticks.velocity_command, axis=1), round(OVERLAY_S * rate_hz))
        real_torque = _at_ticks(run.ticks.robot_stamp_ns, run.states.robot_stamp_ns, run.states.load_nm)
        traces: list[tuple[NDArray[Any], NDArray[Any]]] = [
            (run.ticks.action[:, problem.policy.canonical_from_policy], real_torque),
            *(
                (np.asarray(on_host(rollouts.features[i, case][:, 24:])) / scale, on_host(rollouts.torque_nm[i, case]))
                for i in range(2)
            ),
        ]
        yield reference.sequence, stretch, rate_hz, traces
        case += len(cases)


def _overlay(sequence: str, stretch: slice, rate_hz: float, traces: Traces) -> Section:
    charts = []
    for kind, title in enumerate(("action", "torque, N·m")):
        for joint in OVERLAY_JOINTS:
            lines = []
            for (colour, _), pair in zip(RUNS, traces, strict=True):
                shown = pair[kind][stretch, facts.JOINT_NAMES.index(joint)]
                lines.append(Series(colour, (stretch.start + np.arange(len(shown))) / rate_hz, shown))
            charts.append(Chart(lines, f"{joint} {title}", x_unit=" s", height=150))
    about = "Two knees, in the seconds with the largest commanded velocities. The gaits drift out of phase."
    return Section(f"Robot and simulation: {_plain(sequence)}", about, [Legend(RUNS), Beside(charts)])


def _at_ticks(tick_ns: NDArray[np.int64], state_ns: NDArray[np.int64], values: NDArray[Any]) -> NDArray[Any]:
    return values[np.minimum(np.searchsorted(state_ns, tick_ns), len(state_ns) - 1)]
