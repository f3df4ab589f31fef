"""The identification as one page for people: what was identified beside what was not, and robot beside simulation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from spot_log.page.chart import Series, chart
from spot_log.page.look import Html, boxed, folded, framed, headed, listed, table
from spot_log.page.svg import HALF, esc, legend, liveliest
from spot_model.robot import facts
from spot_model.robot.arrays import on_host
from spot_model.text import counted
from trainer.sysid.identify import Identification
from trainer.sysid.logs import sequence_of
from trainer.sysid.result import ResultData
from trainer.sysid.verdict import ParameterVerdict

OVERLAY_JOINTS: Final = ("fr_kn", "hr_kn")
"""Joints of the overlay: front and hind right knee, as in the paper's comparison figure."""
OVERLAY_S: Final = 3.0
"""Length of the stretch that the overlay shows."""
RUNS: Final = (("var(--real)", "robot"), ("var(--nominal)", "simulation, before"), ("var(--corrected)", "identified"))
NEAR: Final = 1.2
"""Floors up to which the simulated runs count as near to the robot's."""

Traces = Sequence[tuple[NDArray[Any], NDArray[Any]]]
"""Action and torque, each of shape (ticks, 12), of robot, initial and identified simulation."""


def report_page(found: Identification, data: ResultData) -> str:
    """A page that opens from disk, with all it needs inside."""
    return identification_page(data, list(_overlays(found)))


def identification_page(data: ResultData, overlays: Sequence[tuple[str, slice, float, Traces]] = ()) -> str:
    """The page's text.

    Args:
        data: The result.
        overlays: Sequence, stretch of its ticks, rate in Hz, and traces.
    """
    known = [p for p in data.parameters if p.identified]
    unknown = [p for p in data.parameters if not p.identified]
    body = [
        _head(data, known),
        "<div class='two'>",
        boxed("Identified", "", _values(known) or "<p>Nothing; the other box gives the reasons.</p>"),
        boxed(
            "Not identified",
            "For these, the model file holds values that the logs do not contradict.",
            _reasons(unknown),
        ),
        "</div>",
        boxed("Measured directly", "Measured from the logs, without a search.", _measured(data)),
        *(_overlay(*overlay) for overlay in overlays),
        boxed("Search", _score_about(data), _score(data)),
        boxed("Details", "", _details(data)),
    ]
    return framed("Identification", body)


def _head(data: ResultData, known: Sequence[ParameterVerdict]) -> str:
    end = data.score.get("identified")
    is_near = end is not None and data.score_is_over_floor and end <= NEAR
    badge, kind = ("Identified", "good") if len(known) == len(data.parameters) else ("In part", "fair")
    if not known:
        badge, kind = "Not identified", "bad"
    are = "is" if len(known) == 1 else "are"
    headline = f"{len(known)} of {counted(len(data.parameters), 'parameter')} {are} identified"
    told = [f"{counted(len(data.logs), 'log')} of {counted(len(data.sequences), 'command sequence')}."]
    if end is not None and data.score_is_over_floor:
        start = data.score.get("initial")
        before = "" if start is None else f", {start:.2f} before"
        near = (
            "as close to the robot as another real run, or nearly"
            if is_near
            else "still farther from the robot than a real run"
        )
        told.append(f"Simulated runs are {near}: {end:.2f} times the distance of two real runs{before}.")
    elif not data.score_is_over_floor:
        told.append(
            "Record each sequence at least twice. Without repeats, it is not known how close the simulation is."
        )
    return headed(badge, kind, headline, told)


def _values(parameters: Sequence[ParameterVerdict]) -> str:
    rows = [(_plain(p.name), f"{p.value:.4g} {p.unit}", f"{p.low:.4g} to {p.high:.4g}", p.source) for p in parameters]
    return table(("parameter", "value", "90 % interval", "from"), rows)


def _reasons(parameters: Sequence[ParameterVerdict]) -> str:
    by_reason: dict[str, list[str]] = {}
    for p in parameters:
        by_reason.setdefault(p.reason, []).append(_plain(p.name))
    items = (Html(f"<b>{esc('; '.join(names))}</b>: {esc(why)}") for why, names in by_reason.items())
    return listed(items) or "<p>Every parameter is identified.</p>"


def _measured(data: ResultData) -> str:
    return listed(Html(f"{esc(m.what)}: <b>{_amount(m.value, m.unit)}</b> ({esc(m.source)})") for m in data.measured)


def _amount(value: float, unit: str) -> str:
    """A value with its unit; times in milliseconds."""
    return f"{1e3 * value:.3g} ms" if unit == "s" else f"{value:.4g} {esc(unit)}"


def _score_about(data: ResultData) -> str:
    told = "Distance between simulated and real runs for the best model of each generation; less is closer."
    return f"{told} 1 is the distance between two real runs." if data.score_is_over_floor else told


def _score(data: ResultData) -> str:
    best = np.array([np.nan if v is None else v for v in data.score_by_generation])
    if np.isfinite(best).sum() < 2:
        return ""
    x = np.arange(1, len(best) + 1)
    lines = [
        Series("var(--other)", x, best, width=0.0, has_points=True, name="score"),
        Series("var(--corrected)", x, np.fmin.accumulate(best), width=2.0),
    ]
    if data.score_is_over_floor:
        lines.append(Series("var(--floor)", x, np.ones(len(x)), is_dotted=True))
    names = [("var(--other)", "best of the generation"), ("var(--corrected)", "best so far")]
    names += [("var(--floor)", "two real runs")] if data.score_is_over_floor else []
    key = legend(names)
    return key + chart(lines, "score", x_title="generation", height=150)


def _details(data: ResultData) -> str:
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
    floors = [(s.name, s.repeats, s.floor_w1_nm, s.floor_mmd) for s in data.sequences]
    floor_head = ("sequence", "repeats", "floor: Wasserstein, N·m", "MMD")
    parts = [
        folded("Every parameter", table(head, rows)),
        folded("Command sequences, and how far two real runs differ", table(floor_head, floors)),
        folded("Logs", listed(data.logs)),
    ]
    parts.append(folded("What was cut or left out", listed(data.warnings)))
    return "".join(parts)


def _plain(name: str) -> str:
    """``coulomb_friction[hips].level_nm`` as words; the unit stands beside the value."""
    effect, _, parameter = name.partition("].")
    if not parameter:
        return name.replace("_", " ")
    for unit in ("_nm_s_per_rad", "_kg_m2", "_rad_s", "_nm", "_rad", "_kg", "_m_s", "_m", "_s"):
        parameter = parameter.removesuffix(unit)
    return f"{effect.replace('[', ', ')}: {parameter}".replace("_", " ")


def _overlays(found: Identification) -> Iterator[tuple[str, slice, float, Traces]]:
    """For each sequence, action and torque: the robot, and simulations before and after."""
    problem = found.preparation.problem
    space = problem.space
    chosen = space.within_bounds(np.array([v.value for v in found.verdicts]))
    rollouts = problem.simulate(np.stack([space.initial, chosen]))
    case, rate_hz = 0, problem.policy.contract.rate_hz
    scale = problem.policy.contract.action_scale_rad * facts.POLICY_KP_NM_PER_RAD
    for reference, cases in zip(problem.references, problem.cases, strict=True):
        run = next(r for r in found.preparation.logs.compared if sequence_of(r) == reference.sequence)
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


def _overlay(sequence: str, stretch: slice, rate_hz: float, traces: Traces) -> str:
    figures = []
    for kind, title in enumerate(("action", "torque, N·m")):
        for joint in OVERLAY_JOINTS:
            lines = []
            for (colour, _), pair in zip(RUNS, traces, strict=True):
                shown = pair[kind][stretch, facts.JOINT_NAMES.index(joint)]
                x = (stretch.start + np.arange(len(shown))) / rate_hz
                lines.append(Series(colour, x, shown, width=1.5))
            figures.append(f"<div>{chart(lines, f'{joint} {title}', x_unit=' s', width=HALF, height=150)}</div>")
    about = "Two knees, in the seconds with the largest commanded velocities. The gaits drift out of phase."
    content = legend(RUNS) + f"<div class='two' style='margin:0'>{''.join(figures)}</div>"
    return boxed(f"Robot and simulation: {_plain(sequence)}", about, content)


def _at_ticks(tick_ns: NDArray[np.int64], state_ns: NDArray[np.int64], values: NDArray[Any]) -> NDArray[Any]:
    return values[np.minimum(np.searchsorted(state_ns, tick_ns), len(state_ns) - 1)]
