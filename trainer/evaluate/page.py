"""The evaluation as one self-contained HTML page."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from scipy.stats import chi2

from spot_log.page.charts import FEET, stance
from spot_log.page.render import rendered
from spot_log.page.sections import Bar, Bars, Beside, Chart, Content, Fold, Head, Legend, Mark, Section, Series, Table
from spot_model.robot.facts import LEG_NAMES
from spot_model.text import counted
from trainer.evaluate.holds import HOLDS

STEADY: Final = 0.01
"""Share of episodes with a fall up to which a policy is called steady; fewer than its inverse cannot show that."""
WALKS: Final = 0.10
AXES: Final = (("forward", "m/s"), ("sideways", "m/s"), ("turning", "rad/s"))
ENOUGH_FALLS: Final = 3
"""Falls from which their rate is told: its 90 % interval spans less than a factor of ten."""
ENOUGH_S: Final = 600.0
"""Robot time from which few falls bound their rate, s."""
TRIALS: Final = {
    "tracking": "tracking",
    "top_speed": "highest speed",
    "episodes_slow": "slow",
    "episodes_fast": "fast",
    "episodes_beyond": "fastest",
    "fitted_robot": "fitted robot",
    "possible_robots": "possible robots",
    "pushes": "push",
    "slippery_patch": "slippery",
}
"""Each trial in a word."""
SHOWN: Final = 5
"""Falls that are told before the rest are folded."""
STRIDES, SAMPLES = 3, 60
Evaluated = tuple[str, str, Mapping[str, Any]]
"""A colour, a name, and the figures of an evaluation."""


def evaluation_page(result: dict[str, Any], file: str) -> str:
    """The page's text.

    Args:
        result: Of :func:`trainer.evaluate.trials.evaluate_setting`.
        file: Name of the policy's file, by which people know it; its contract may have the name of another.
    """
    data = Fold("All figures, as in evaluation.json", Mark(json.dumps(result, indent=1), "pre"))
    physics = result["physics"]
    about = (
        f"Simulated in physics steps of {1000 * physics['timestep_s']:g} ms ({physics['integrator']}), seed "
        f"{result['seed']}. The digests of policy and model are among the figures."
    )
    key = Legend([("var(--other)", "commanded"), ("var(--floor)", "held")])
    speed = [key, speed_chart("var(--other)", [("var(--floor)", "held", result)], height=265)]
    about_speed = "Each forward speed is held for 10 s. Where the line is interrupted, the robot fell."
    about_errors = "Mean distance from the command, one axis at a time."
    errors = Section("Tracking error", about_errors, _errors(result["tracking"]["points"]))
    about_falls = "Friction, masses and starts are drawn at random for each robot."
    parts = [
        _head(result, file),
        Beside([Section("Speed against command", about_speed, speed), errors]),
        Section("Falls and disturbances", about_falls, _trials(result)),
        _holds(result["holds"]),
        _gait(_forward(result)),
        Section("Power", "Positive work of all motors.", power_chart([("var(--floor)", "", result)], height=150)),
        Section("Where this comes from", about, data),
    ]
    return rendered(f"{file}: evaluation", parts)


def _head(result: Mapping[str, Any], file: str) -> Head:
    top, tracking, slow = result["top_speed"], result["tracking"], result["episodes_slow"]
    share = slow["falls"] / slow["episodes"]
    is_steady = share <= STEADY and slow["episodes"] * STEADY >= 1.0
    badge, kind = ("Steady", "good") if is_steady else ("Walks", "fair") if share <= WALKS else ("Falls", "bad")
    held = top["sustained_m_s"]
    if held is None:
        headline = f"Policy {file} falls at every speed that was tried"
    elif top.get("gait") == "stand":
        badge, kind, headline = "Stands", "bad", f"Policy {file} stands still at every speed that was tried"
    else:
        headline = f"Policy {file} holds {held:.2f} m/s"
    name = result["policy"]
    meta = "Simulated; a robot may differ."
    meta += "" if name == file.removesuffix(".onnx") else f" The file says that its policy is called {name}."
    sentences = [*_sentences(top, tracking, slow), _holds_sentence(result["holds"])]
    return Head(badge, kind, headline, sentences, meta)


def _sentences(top: Mapping[str, Any], tracking: Mapping[str, Any], slow: Mapping[str, Any]) -> Iterator[str]:
    held = top["sustained_m_s"]
    error, is_walk = tracking["mean_forward_error_m_s"], held is not None and top.get("gait") != "stand"
    follows = f"It follows a forward command within {error:.3f} m/s on average. " if is_walk and error else ""
    high = slow["v_x_m_s"][1]
    yield f"{follows}{slow['falls']} of {slow['episodes']} randomised episodes up to {high:g} m/s end in a fall."
    if is_walk:
        named = f"a {top['gait']}, " if top.get("gait") not in (None, "", "none") else ""
        yield (
            f"At its highest speed: {named}{top['stride_hz']:.1f} strides a second, all feet in the air for "
            f"{100 * top['flight_share']:.0f} % of the time."
        )


def speed_chart(asked_colour: str, evaluated: Sequence[Evaluated], height: float) -> Chart:
    """The speed that policies hold over the speed that is commanded."""
    curves = [e["top_speed"]["curve"] for _, _, e in evaluated]
    asked = [c[0] for c in max(curves, key=lambda curve: float(curve[-1][0]))]
    lines = [Series(asked_colour, asked, asked, is_dotted=True)]
    for (colour, name, _), curve in zip(evaluated, curves, strict=True):
        held = [c[1] if c[2] else np.nan for c in curve]
        lines.append(Series(colour, [c[0] for c in curve], held, has_points=True, name=name))
    return Chart(lines, "held, m/s", x_title="commanded forward, m/s", height=height)


def power_chart(evaluated: Sequence[Evaluated], height: float) -> Chart:
    """The power of policies over the commanded forward speed."""
    lines = []
    for colour, name, e in evaluated:
        points = _forward(e)
        x = [p["command"][0] for p in points]
        lines.append(Series(colour, x, [p["power_w"] for p in points], has_points=True, name=name))
    return Chart(lines, "power, W", x_title="commanded forward, m/s", height=height, zero=True)


def _errors(points: Sequence[Mapping[str, Any]]) -> list[Chart]:
    """A chart for each axis of the command; the two in m/s share a scale."""
    found = []
    for axis in range(3):
        own = [p for p in points if not any(np.delete(p["command"], axis))]
        own.sort(key=lambda p: float(p["command"][axis]))
        errors = np.array([p["error"][axis] for p in own], dtype=np.float64)
        found.append(([p["command"][axis] for p in own], errors))
    tops = [float(np.nanmax(errors, initial=0.0)) for _, errors in found]
    drawn = []
    for (asked, errors), (name, unit), top in zip(found, AXES, (max(tops[:2]), max(tops[:2]), tops[2]), strict=True):
        line = Series("var(--floor)", asked, errors, has_points=True, name=f"{name}: error")
        y_range, x_title = (0.0, 1.1 * top or 1.0), f"commanded {name}, {unit}"
        drawn.append(Chart([line], f"error, {unit}", x_title=x_title, height=70, y_range=y_range))
    return drawn


def _trials(result: Mapping[str, Any]) -> Content:
    rows = []
    for key in ("episodes_slow", "episodes_fast", "episodes_beyond"):
        if key in result:
            trial = result[key]
            low, high = trial["v_x_m_s"]
            what = f"20 s with noise and a push, {low:g} to {high:g} m/s"
            rows.append((what, f"{trial['falls']} of {trial['episodes']} fell", _how_often(trial)))
    for key, what in (("pushes", "a push of 1 m/s"), ("slippery_patch", "a second on slippery ground (μ = 0.3)")):
        trial = result[key]
        rows.append((f"{what}, at {trial['v_x_m_s']:g} m/s", f"{trial['survived']} of {trial['trials']} stayed up", ""))
    for point in result["tracking"]["points"]:
        v_x, v_y, yaw = point["command"]
        if v_x != 0.0 and v_y == 0.0 and yaw != 0.0:
            what = f"commanded to turn at {yaw:g} rad/s while walking at {v_x:g} m/s"
            rows.append((what, f"turns at {point['velocity'][2]:.2f} rad/s", ""))
    rows.append(("commanded to stand", f"moves at {result['tracking']['standing_speed_m_s']:.3f} m/s", ""))
    rows.append(("largest torque", f"{result['tracking']['peak_torque_nm']:g} N·m", ""))
    falls = [(TRIALS[name], fall["why"]) for name, f in result.items() if name in TRIALS for fall in f.get("fell", [])]
    more = Fold(f"{len(falls) - SHOWN} more", Table((), falls[SHOWN:]))
    told = ((what, (Mark(came), f"; {often}" if often else "")) for what, came, often in rows)
    return [Table((), told), Section("When and why", "", [Table((), falls[:SHOWN]), more])]


def _holds(figures: Mapping[str, Any]) -> Section:
    """A bar for each condition: as long as the share of robots that hold, and coloured by whether enough do."""
    parts = []
    for group in dict.fromkeys(c["group"] for c in figures["conditions"]):
        rows = [(c["name"], "", [_held_bar(c)]) for c in figures["conditions"] if c["group"] == group]
        parts.append(Section(group, "", Bars(rows, f"Robots that hold: {group}")))
    low, high = figures["speed_m_s"]
    about = (
        f"A robot holds if it stays up for {figures['seconds']:g} s at commands of {low:g} to {high:g} m/s, and moves "
        f"at {100 * figures['progress_needed']:g} % of the commanded speed or more. Behind each bar: robots that hold, "
        f"and the mean speed of those that stay up in percent of the command. Red: fewer than {100 * HOLDS:g} % hold. "
        "On slopes and steps, robots walk straight on."
    )
    return Section("Where it holds", about, Beside(parts))


def _holds_sentence(figures: Mapping[str, Any]) -> str:
    held = [c["held"] >= HOLDS * c["robots"] for c in figures["conditions"]]
    robots = counted(max(c["robots"] for c in figures["conditions"]), "robot")
    where = f"{sum(held)} of {len(held)} conditions, each tried with {robots}"
    return f"At up to {figures['speed_m_s'][1]:g} m/s it holds in {where}."


def _held_bar(c: Mapping[str, Any]) -> Bar:
    share = c["held"] / c["robots"]
    speed = "" if c["progress"] is None else f" · {100 * c['progress']:.0f} %"
    tip = f"{c['stayed_up']} of {c['robots']} stayed up, {c['held']} of them kept the speed"
    colour = "var(--good)" if share >= HOLDS else "var(--bad)"
    return Bar(share, colour, f"{c['held']} of {c['robots']}{speed}", tip)


def _how_often(trial: Mapping[str, Any]) -> str:
    """Falls and the time in which they happened; their rate only where they tell it."""
    falls, hours = trial["falls"], trial["robot_s"] / 3600.0
    told = f"{counted(falls, 'fall')} in {trial['robot_s']:.0f} s of walking"
    low, high = (
        0.5 * float(chi2.ppf(p, n)) / hours if n else 0.0 for p, n in ((0.05, 2 * falls), (0.95, 2 * falls + 2))
    )
    if falls >= ENOUGH_FALLS:
        return f"{told}: {_two(low)} to {_two(high)} an hour (90 % interval)"
    return f"{told}: at most {_two(high)} an hour (95 % bound)" if trial["robot_s"] >= ENOUGH_S else told


def _two(value: float) -> str:
    """Two digits of a number, without an exponent."""
    return f"{float(f'{value:.2g}'):g}"


def _forward(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    points = [p for p in result["tracking"]["points"] if p["command"][1] == 0.0 and p["command"][2] == 0.0]
    return sorted((p for p in points if not p["fell"]), key=lambda p: float(p["command"][0]))


def _gait(points: list[dict[str, Any]]) -> Section:
    """Duty factors over speed; and the strides of a slow, a middle and a fast walk whose phases are known."""
    x = [p["command"][0] for p in points]
    lines = [Series(colour, x, [p["duty_factors"][i] for p in points]) for i, colour in enumerate(FEET)]
    lines.append(Series("var(--ink)", x, [p["flight_share"] for p in points], is_dotted=True))
    names = [(colour, f"{leg} on the ground") for colour, leg in zip(FEET, LEG_NAMES, strict=True)]
    chart = Chart(lines, "share of time", x_title="commanded forward, m/s", zero=True)
    known = [p for p in points if p["command"][0] > 0.0 and all(v is not None for v in p.get("phases", [None]))]
    strides = [_stride(known[i]) for i in sorted({0, len(known) // 2, len(known) - 1})] if known else []
    key = Legend([*names, ("var(--ink)", "no foot on the ground")])
    about = "Share of time that each foot is on the ground, and that none is. In an even gait the four lines coincide."
    return Section("Gait", about, [key, chart, *strides] if points else None)


def _stride(point: Mapping[str, Any]) -> Section:
    """Feet on the ground over three strides, from phases and duty factors."""
    at = np.arange(STRIDES * SAMPLES) / SAMPLES
    since = (at[:, None] - np.array(point["phases"])[None, :]) % 1.0
    name = f"{point['gait']}, " if point.get("gait") else ""
    title = f"{point['command'][0]:g} m/s: {name}{point['stride_hz']:.1f} strides a second; three strides"
    return Section(title, "", stance(since < np.array(point["duty_factors"])[None, :], LEG_NAMES, "var(--floor)"))
