"""The evaluation as one self-contained HTML page."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np
from scipy.stats import chi2

from spot_log.page.chart import Series, chart
from spot_log.page.look import Html, boxed, facts, folded, framed, headed
from spot_log.page.rows import Bar, bars, stance
from spot_log.page.svg import HALF, esc, legend
from spot_model.robot.facts import LEG_NAMES
from spot_model.text import counted
from trainer.evaluate.holds import HOLDS

STEADY: Final = 0.01
"""Share of randomised episodes that may end in a fall for a policy that is called steady.

Fewer episodes than its inverse cannot show that.
"""
WALKS: Final = 0.10
AXES: Final = (("forward", "m/s"), ("sideways", "m/s"), ("turning", "rad/s"))
ENOUGH_FALLS: Final = 3
"""Falls from which their rate is told: its 90 % interval spans less than a factor of ten."""
ENOUGH_S: Final = 600.0
"""Robot time from which few falls bound their rate, s."""
FEET: Final = ("var(--floor)", "var(--group)", "var(--good)", "var(--unknown)")
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
STRIDES: Final = 3
SAMPLES: Final = 60


def evaluation_page(result: dict[str, Any], file: str) -> str:
    """The page's text.

    Args:
        result: Of :func:`trainer.evaluate.trials.evaluate`.
        file: Name of the policy's file, by which people know it; its contract may have the name of another.
    """
    data = folded("All figures, as in evaluation.json", f"<pre>{esc(json.dumps(result, indent=1))}</pre>")
    physics = result["physics"]
    about = (
        f"Simulated in physics steps of {1000 * physics['timestep_s']:g} ms ({physics['integrator']}), seed "
        f"{result['seed']}. The digests of policy and model are among the figures."
    )
    body = [
        _head(result, file),
        "<div class='two'>",
        boxed(
            "Speed against command",
            "Each forward speed is held for 10 s. Where the line is interrupted, the robot fell.",
            _speed(result),
        ),
        boxed("Tracking error", "Mean distance from the command, one axis at a time.", _errors(result)),
        "</div>",
        boxed(
            "Falls and disturbances",
            "Friction, masses and starts are drawn at random for each robot.",
            _trials(result),
        ),
        _holds(result["holds"]),
        _gait(result),
        boxed("Power", "Positive work of all motors.", _power(result)),
        boxed("Where this comes from", about, data),
    ]
    return framed(f"{file}: evaluation", body)


def _head(result: Mapping[str, Any], file: str) -> str:
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
    return headed(badge, kind, headline, sentences, meta)


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


def _speed(result: Mapping[str, Any]) -> str:
    curve = result["top_speed"]["curve"]
    asked = [c[0] for c in curve]
    held = [c[1] if c[2] else np.nan for c in curve]
    lines = [
        Series("var(--other)", asked, asked, is_dotted=True),
        Series("var(--floor)", asked, held, has_points=True, name="held"),
    ]
    key = legend([("var(--other)", "commanded"), ("var(--floor)", "held")])
    return key + chart(lines, "held, m/s", x_title="commanded forward, m/s", width=HALF, height=265)


def _errors(result: Mapping[str, Any]) -> str:
    """A chart for each axis of the command; the two in m/s share a scale."""
    found = []
    for axis in range(3):
        others = [i for i in range(3) if i != axis]
        points = [p for p in result["tracking"]["points"] if all(p["command"][i] == 0.0 for i in others)]
        points.sort(key=lambda p: float(p["command"][axis]))
        errors = np.array([p["error"][axis] for p in points], dtype=np.float64)
        found.append(([p["command"][axis] for p in points], errors))
    tops = [float(np.nanmax(errors, initial=0.0)) for _, errors in found]
    drawn = []
    for (asked, errors), (name, unit), top in zip(found, AXES, (max(tops[:2]), max(tops[:2]), tops[2]), strict=True):
        line = Series("var(--floor)", asked, errors, has_points=True, name=f"{name}: error")
        y_range = (0.0, 1.1 * top or 1.0)
        x_title = f"commanded {name}, {unit}"
        drawn.append(chart([line], f"error, {unit}", x_title=x_title, width=HALF, height=70, y_range=y_range))
    return "".join(drawn)


def _trials(result: Mapping[str, Any]) -> str:
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
    rows += [
        (f"commanded to turn at {yaw:g} rad/s while walking at {v_x:g} m/s", f"turns at {held:.2f} rad/s", "")
        for v_x, yaw, held in turns_at_speed(result["tracking"])
    ]
    rows.append(("commanded to stand", f"moves at {result['tracking']['standing_speed_m_s']:.3f} m/s", ""))
    rows.append(("largest torque", f"{result['tracking']['peak_torque_nm']:g} N·m", ""))
    found = facts((what, Html(f"<b>{esc(came)}</b>{esc(f'; {more}' if more else '')}")) for what, came, more in rows)
    falls = [(TRIALS[name], fall["why"]) for name, figures in result.items() for fall in _fell(figures)]
    why = f"<h3>When and why</h3>{facts(falls[:SHOWN])}" if falls else ""
    if falls[SHOWN:]:
        why += folded(f"{len(falls) - SHOWN} more", facts(falls[SHOWN:]))
    return f"{found}{why}"


def _holds(figures: Mapping[str, Any]) -> str:
    """A bar for each condition: as long as the share of robots that hold, and coloured by whether enough do."""
    parts = []
    for group in dict.fromkeys(c["group"] for c in figures["conditions"]):
        rows = [(c["name"], "", [_held_bar(c)]) for c in figures["conditions"] if c["group"] == group]
        parts.append(f"<div><h3>{esc(group)}</h3>{bars(rows, f'Robots that hold: {group}', left=165, right=125)}</div>")
    low, high = figures["speed_m_s"]
    about = (
        f"A robot holds if it stays up for {figures['seconds']:g} s at commands of {low:g} to {high:g} m/s, and moves "
        f"at {100 * figures['progress_needed']:g} % of the commanded speed or more. Behind each bar: robots that hold, "
        f"and the mean speed of those that stay up in percent of the command. Red: fewer than {100 * HOLDS:g} % hold. "
        "On slopes and steps, robots walk straight on."
    )
    return boxed("Where it holds", about, f"<div class='two'>{''.join(parts)}</div>")


def _holds_sentence(figures: Mapping[str, Any]) -> str:
    conditions = figures["conditions"]
    enough = sum(c["held"] >= HOLDS * c["robots"] for c in conditions)
    robots = counted(max(c["robots"] for c in conditions), "robot")
    return (
        f"At up to {figures['speed_m_s'][1]:g} m/s it holds in {enough} of {len(conditions)} conditions, "
        f"each tried with {robots}."
    )


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


def turns_at_speed(tracking: Mapping[str, Any]) -> Iterator[tuple[float, float, float]]:
    """Commanded V_x (m/s), commanded and held ω_z (rad/s) of the walks that also turn."""
    for point in tracking["points"]:
        v_x, v_y, yaw = point["command"]
        if v_x != 0.0 and v_y == 0.0 and yaw != 0.0:
            yield v_x, yaw, point["velocity"][2]


def _fell(figures: Any) -> list[dict[str, Any]]:
    return list(figures.get("fell", [])) if isinstance(figures, dict) else []


def _forward(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    points = [p for p in result["tracking"]["points"] if p["command"][1] == 0.0 and p["command"][2] == 0.0]
    return sorted((p for p in points if not p["fell"]), key=lambda p: float(p["command"][0]))


def _gait(result: Mapping[str, Any]) -> str:
    points = _forward(result)
    if not points:
        return ""
    x = [p["command"][0] for p in points]
    duty = [
        Series(FEET[i], x, [p["duty_factors"][i] for p in points], name=f"{leg} stands")
        for i, leg in enumerate(LEG_NAMES)
    ]
    lines = [*duty, Series("var(--ink)", x, [p["flight_share"] for p in points], is_dotted=True)]
    key = legend(
        [
            *((FEET[i], f"{leg} on the ground") for i, leg in enumerate(LEG_NAMES)),
            ("var(--ink)", "no foot on the ground"),
        ]
    )
    picture = chart(lines, "share of time", x_title="commanded forward, m/s", height=190, zero=True)
    diagrams = "".join(_stride(p) for p in _chosen(points))
    about = "Share of time that each foot is on the ground, and that none is. In an even gait the four lines coincide."
    return boxed("Gait", about, key + picture + diagrams)


def _chosen(points: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A slow, a middle and a fast walk whose phases are known."""
    known = [p for p in points if p["command"][0] > 0.0 and all(v is not None for v in p.get("phases", [None]))]
    return [known[i] for i in sorted({0, len(known) // 2, len(known) - 1})] if known else []


def _stride(point: Mapping[str, Any]) -> str:
    """Feet on the ground over three strides, from phases and duty factors."""
    at = np.arange(STRIDES * SAMPLES) / SAMPLES
    since = (at[:, None] - np.array(point["phases"])[None, :]) % 1.0
    name = f"{point['gait']}, " if point.get("gait") else ""
    title = f"{point['command'][0]:g} m/s: {name}{point['stride_hz']:.1f} strides a second"
    picture = stance(since < np.array(point["duty_factors"])[None, :], LEG_NAMES, "var(--floor)")
    return f"<h3>{esc(title)}; three strides</h3>{picture}"


def _power(result: Mapping[str, Any]) -> str:
    points = _forward(result)
    line = Series("var(--floor)", [p["command"][0] for p in points], [p["power_w"] for p in points], has_points=True)
    return chart([line], "power, W", x_title="commanded forward, m/s", height=150, zero=True) if points else ""
