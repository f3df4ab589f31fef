"""The identification as one page for people: parameters, score over generations, real against simulated joints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from spot_log.page.kit import Html, bullets, escaped, marked, number, page, plot, section, styled, table
from spot_model.robot import facts
from trainer.sysid.identify.identify import Identification
from trainer.sysid.identify.result import ParameterData, ResultData

OVERLAY_JOINTS: Final = ("fr_kn", "hr_kn")
"""Joints of the overlay: front and hind right knee, as in the paper's comparison figure."""
OVERLAY_S: Final = 3.0
"""Length of the stretch that the overlay shows."""


def write_report(found: Identification, data: ResultData, path: Path) -> None:
    """Write a page that opens from disk, with all it needs inside."""
    body = [
        section("Parameters", _parameter_table(data)),
        _not_identified(data),
        _measured(data),
        section("Command sequences and their real-versus-real floor", _sequence_table(data)),
        *[section("", plot(figure)) for figure in (score_figure(data), *overlay_figures(found))],
        section("What was cut or left out", bullets(data.warnings)) if data.warnings else "",
    ]
    path.write_text(page("System identification", body, note=summary(data)), encoding="utf-8")


def summary(data: ResultData) -> str:
    """What was found, in two or three sentences."""
    found = [p for p in data.parameters if p.identified]
    unit = " (1 is the real-versus-real floor)" if data.score_is_over_floor else " (no floor: repeats are missing)"
    score = ", ".join(f"{name} {'diverged' if value is None else f'{value:.2f}'}" for name, value in data.score.items())
    return (
        f"{len(found)} of {len(data.parameters)} parameters are identified from {len(data.logs)} logs of "
        f"{len(data.sequences)} command sequences. Score{unit}: {score}."
    )


def score_figure(data: ResultData) -> go.Figure:
    """Best score of each generation, and the best so far."""
    best = np.array([np.nan if v is None else v for v in data.score_by_generation])
    figure = go.Figure()
    figure.add_scatter(y=best, mode="markers", name="best of the generation", marker={"size": 5})
    figure.add_scatter(y=np.fmin.accumulate(best), mode="lines", name="best so far")
    if data.score_is_over_floor:
        figure.add_hline(y=1.0, line_dash="dot", annotation_text="real versus real")
    return styled(figure, 380, title="Score over generations", x="generation", y="score")


def overlay_figures(found: Identification) -> list[go.Figure]:
    """For each sequence, action and torque of two knees: the robot, and simulations before and after."""
    problem = found.preparation.problem
    space = problem.space
    chosen = space.within_bounds(np.array([v.value for v in found.verdicts]))
    rollouts = problem.simulate(np.stack([space.initial, chosen]))
    figures, case = [], 0
    for reference, cases in zip(problem.references, problem.cases, strict=True):
        run = next(r for r in found.preparation.logs.compared if r.sequence == reference.sequence)
        n_ticks = len(run.ticks.action)
        stretch = _liveliest(run.ticks.velocity_command, n_ticks, problem.policy.contract.rate_hz)
        real_torque = _at_ticks(run.ticks.robot_stamp_ns, run.states.robot_stamp_ns, run.states.load_nm)
        real_action = run.ticks.action[:, problem.policy.canonical_from_policy]
        scale = problem.policy.contract.action_scale_rad * facts.POLICY_KP_NM_PER_RAD
        traces = {
            "robot": (real_action, real_torque),
            "simulation, initial": (rollouts.features[0, case][:, 24:] / scale, rollouts.torque_nm[0, case]),
            "simulation, identified": (rollouts.features[1, case][:, 24:] / scale, rollouts.torque_nm[1, case]),
        }
        figures.append(_overlay(reference.sequence, traces, stretch, problem.policy.contract.rate_hz))
        case += len(cases)
    return figures


def _overlay(
    sequence: str, traces: dict[str, tuple[NDArray[Any], NDArray[Any]]], stretch: slice, rate_hz: float
) -> go.Figure:
    titles = [f"{joint} {kind}" for kind in ("action", "torque, N·m") for joint in OVERLAY_JOINTS]
    figure = make_subplots(rows=2, cols=2, subplot_titles=titles, shared_xaxes=True)
    colours = ("#1c2430", "#c06a3d", "#2f7f9e")
    for (name, pair), colour in zip(traces.items(), colours, strict=True):
        for row, values in enumerate(pair, start=1):
            for column, joint in enumerate(OVERLAY_JOINTS, start=1):
                shown = values[stretch, facts.JOINT_NAMES.index(joint)]
                figure.add_scatter(
                    x=(stretch.start + np.arange(len(shown))) / rate_hz,
                    y=shown,
                    name=name,
                    legendgroup=name,
                    showlegend=row == column == 1,
                    line={"color": colour, "width": 1.5},
                    row=row,
                    col=column,
                )
    figure.update_xaxes(title_text="time, s", row=2)
    return styled(figure, 560, title=f"Sequence {sequence}: robot and simulation")


def _liveliest(command: NDArray[np.float64], n_ticks: int, rate_hz: float) -> slice:
    """The stretch in which the largest velocities are commanded."""
    length = min(n_ticks, round(OVERLAY_S * rate_hz))
    size = np.cumsum(np.concatenate([[0.0], np.linalg.norm(command, axis=1)]))
    start = int(np.argmax(size[length:] - size[:-length]))
    return slice(start, start + length)


def _at_ticks(tick_ns: NDArray[np.int64], state_ns: NDArray[np.int64], values: NDArray[Any]) -> NDArray[Any]:
    return values[np.minimum(np.searchsorted(state_ns, tick_ns), len(state_ns) - 1)]


def _parameter_table(data: ResultData) -> Html:
    head = ("parameter", "unit", "initial", "value", "90 % interval", "identified by", "the paper's search alone")
    rows = [
        (
            p.name,
            p.unit,
            p.initial,
            p.value,
            f"{number(p.low)} … {number(p.high)}",
            marked(p.source, "good" if p.identified else "bad"),
            f"{number(p.by_search.value)} ({number(p.by_search.low)} … {number(p.by_search.high)})",
        )
        for p in data.parameters
    ]
    return table(head, rows)


def _not_identified(data: ResultData) -> str:
    missing = [p for p in data.parameters if not p.identified]
    if not missing:
        return ""
    items = bullets(Html(f"<b>{escaped(p.name)}</b>: {escaped(p.reason)}") for p in missing)
    note = "Their values in the model file are ones that the logs do not contradict, no more."
    return section("Not identified", items, note)


def _measured(data: ResultData) -> str:
    items = [f"{m.what}: {number(m.value)} {m.unit} ({m.source})" for m in data.measured]
    return section("Measured directly, not searched", bullets(items)) if items else ""


def _sequence_table(data: ResultData) -> Html:
    rows = [(s.name, s.repeats, s.floor_w1_nm, s.floor_mmd) for s in data.sequences]
    return table(("sequence", "repeats", "Wasserstein, N·m", "MMD"), rows)


def text_table(parameters: Sequence[ParameterData]) -> str:
    """The parameters as lines for a terminal."""
    width = max(len(p.name) for p in parameters)
    lines = [
        f"{p.name:<{width}}  {p.value:9.4g} {p.unit:<6} [{p.low:.4g}, {p.high:.4g}]  {p.source}"
        + ("" if p.identified else f": {p.reason}")
        for p in parameters
    ]
    return "\n".join(lines)
