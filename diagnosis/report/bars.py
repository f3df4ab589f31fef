"""Bars and intervals: the ranking with probabilities, the gap before and after, the shrink."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from diagnosis.document import FoundEffect, Shrink, Verdict
from diagnosis.report.words import parameter, plain
from spot_log.page.svg import disc, esc, heat, line, nice_ticks, rect, svg, text

WIDTH: Final = 560
LABELS: Final = 250
MAX_EFFECTS: Final = 9
MEANING: Final = {
    "var(--found)": "Red: found.",
    "var(--group)": "Orange: these logs cannot rule it out.",
    "var(--other)": "Grey: tried instead, and worse.",
}
"""What the colours of effects say."""
FLOORS: Final = {"robot": "two runs of the robot", "model": "two simulated runs"}
"""Whose distance the floor of a shrink is."""


def ranked(verdict: Verdict) -> list[tuple[str, float, str]]:
    """The effects that :func:`ranking` draws: name, probability, colour."""
    rows: dict[str, float] = {}
    for effect in verdict.effects:
        for name, p in effect.rivals.items():
            rows[name] = max(rows.get(name, 0.0), p)
    chosen = {e.name for e in verdict.effects}
    grouped = {m for e in verdict.effects for m in e.group}
    return [
        (n, rows[n], "var(--found)" if n in chosen else "var(--group)" if n in grouped else "var(--other)")
        for n in sorted(rows, key=lambda n: -rows[n])[:MAX_EFFECTS]
        if rows[n] >= 0.005 or n in chosen
    ]


def ranking(verdict: Verdict) -> str:
    """Probabilities of effects, none and unknown."""
    bars = [
        *ranked(verdict),
        ("none", verdict.probability_none, "var(--none)"),
        ("unknown", verdict.probability_unknown, "var(--unknown)"),
    ]
    return _bars(bars, 1.0, lambda v: f"{v:.2f}", "Probability of each effect")


def by_joint(gaps: Mapping[str, float], shares: Mapping[str, float], named: frozenset[str]) -> str:
    """The gap of each joint of a robot that has no picture."""
    top = max(gaps.values(), default=1.0) or 1.0
    bars = [(f"{j} ◂" if j in named else j, v, heat(shares.get(j, 0.0))) for j, v in gaps.items()]
    return _bars(bars, top, lambda v: f"{v:.3g}", "Gap by joint")


def _bars(bars: Sequence[tuple[str, float, str]], top: float, say: object, label: str) -> str:
    row, width = 30, WIDTH - LABELS - 60
    parts = []
    for i, (name, value, colour) in enumerate(bars):
        y = 8 + row * i
        parts.append(text(LABELS - 10, y + 16, plain(name), size=13.5, anchor="end"))
        parts.append(rect(LABELS, y + 3, width, 18, "var(--empty)", radius=4))
        words = say(value) if callable(say) else str(value)
        parts.append(rect(LABELS, y + 3, width * value / top, 18, colour, f"{plain(name)}: {words}", radius=4))
        parts.append(text(LABELS + width + 8, y + 17, words, size=13.5, weight=600))
    return svg(WIDTH, 16 + row * len(bars), parts, label)


def shrink_line(shrink: Shrink) -> str:
    """Share of the gap that goes, with its interval, and that of the best wrong effect."""
    if shrink.s is None:
        return ""
    low_end = min(-0.25, max(-1.0, shrink.s_low if shrink.s_low is not None else 0.0) - 0.1)
    values = [v for v in (shrink.s_high, shrink.s) if v is not None]
    high_end = max(1.15, min(2.0, max(values)) + 0.1)
    width, x0, y = 520, 24, 62

    def at(v: float) -> float:
        return x0 + (min(max(v, low_end), high_end) - low_end) / (high_end - low_end) * (width - 2 * x0)

    parts = [line([(at(low_end), y), (at(high_end), y)], "var(--line)", 3)]
    for tick in nice_ticks(low_end, high_end, 6):
        parts += [
            line([(at(tick), y - 5), (at(tick), y + 5)], "var(--line)", 1.5),
            text(at(tick), y + 24, f"{100 * tick:.0f} %", size=12, anchor="middle", css="soft"),
        ]
    parts.append(text(at(0.0), y + 42, "no change", size=12, anchor="middle", css="soft"))
    parts.append(text(width - 2, y + 42, f"as close as {FLOORS[shrink.floor_of]}", size=12, anchor="end", css="soft"))
    told = f"{100 * shrink.s:.0f} % of the gap closes"
    if shrink.s_low is not None and shrink.s_high is not None:
        told += f", 90 % interval {100 * shrink.s_low:.0f} to {100 * shrink.s_high:.0f} %"
        parts.append(line([(at(shrink.s_low), y), (at(shrink.s_high), y)], "var(--corrected)", 9, "opacity:.45"))
    parts.append(disc(at(shrink.s), y, 9, "var(--corrected)", told))
    parts.append(text(at(shrink.s), y - 18, f"{100 * shrink.s:.0f} %", size=16, anchor="middle", weight=700))
    if shrink.placebo is not None:
        x = at(shrink.placebo.s)
        parts.append(
            disc(
                x,
                y,
                6,
                "var(--card)",
                f"placebo, {plain(shrink.placebo.name)}: {shrink.placebo.s:.2f}",
                "var(--other)",
                3,
            )
        )
        far = abs(x - at(shrink.s)) > 70
        named = plain(shrink.placebo.name)
        parts.append(text(x, y - 14 if far else y + 60, named, size=12, anchor="middle", css="soft"))
    return svg(width, 128, parts, told)


def gap_bars(shrink: Shrink) -> str:
    """Before, after and floor of each measure, each on its own scale."""
    rows = [("all signals", "× floor", shrink.d0, shrink.d1, shrink.floor)]
    rows += [(o.name, o.unit, o.before, o.after, o.floor) for o in shrink.beside]
    colours = ("var(--nominal)", "var(--corrected)", "var(--floor)")
    bar, gap, left, width = 15, 18, 118, 520
    parts, y = [], 6.0
    for name, unit, *values in rows:
        top = max(*values, 1e-12)
        parts.append(text(left - 10, y + 1.5 * bar, name, size=13, anchor="end"))
        parts.append(text(left - 10, y + 2.6 * bar, unit, size=11, anchor="end", css="soft"))
        for value, colour in zip(values, colours, strict=True):
            if colour == colours[-1] and value <= 0.0:  # without repeats there is no floor
                continue
            span = (width - left - 70) * value / top
            parts.append(rect(left, y, span, bar - 2, colour, f"{name}: {value:.3g} {unit}"))
            parts.append(text(left + span + 6, y + bar - 4, f"{value:.3g}", size=12))
            y += bar
        y += gap
    return svg(width, y, parts, f"Gap before and after, and between {FLOORS[shrink.floor_of]}")


def parameters(effect: FoundEffect) -> str:
    """Parameters of an effect, with intervals, as an HTML table."""
    rows = "".join(
        f"<tr><th>{esc(parameter(name))}</th><td><b>{p.value:.4g}</b> {esc(p.unit)}</td>"
        f"<td>90 %: {p.low:.4g} to {p.high:.4g}</td></tr>"
        for name, p in effect.parameters.items()
    )
    return f"<table>{rows}</table>" if rows else ""
