"""The verdict in about twelve lines: the page's words and figures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from diagnosis.document import Difference, Verdict
from diagnosis.report import words

MOST: Final = 3
"""Differences, and numbers that stand out, that are told; the page has all."""


def twelve_lines(verdict: Verdict, paths: Mapping[str, Path]) -> list[str]:
    """The lines for a terminal."""
    v = verdict
    used = sum(s == "used" for s in v.channels.values())
    lines = [("warning", w) for w in v.warnings]
    lines += [
        ("verdict", v.headline or words.headline(v)),
        ("logs", f"{len(v.logs)}; {used} of {len(v.channels)} channels can be used"),
    ]
    lines += [("difference", _difference(d)) for d in v.differences[:MOST]] or [("difference", "none is shown")]
    lines.append(("otherwise", f"probability of nothing {v.probability_none:.2f}, of an unknown effect {_unknown(v)}"))
    lines.append(("calibration", words.calibration_told(v.calibration.numbers)))
    all_ = words.whole(v)
    together = [words.gap_told(g) for g in all_.gaps] if all_ is not None else []
    lines.append(("corrected", "; ".join(together) or "not measured"))
    if v.remainder:
        lines.append(("remains", "; ".join(map(words.left_told, v.remainder))))
    if v.invisible:
        lines.append(("invisible", ", ".join(v.invisible)))
    split = next((d.split for d in v.differences if d.split is not None), None)
    if split is not None:
        lines.append(("to decide", split.command))
    if v.log_advice:
        lines.append(("advice", v.log_advice[0]))
    lines += [(name, str(paths.get(name, "-"))) for name in ("model", "report")]
    return [f"{name:<12}{told}" for name, told in lines]


def _difference(d: Difference) -> str:
    values = ", ".join(words.size_told(name, p) for name, p in d.parameters.items())
    parts = [words.gap_told(g) for g in d.consequences.gaps] if d.consequences is not None else []
    change = words.largest_change([d.consequences]) if d.consequences is not None else None
    does = [words.change_told(change)] if change is not None else parts[:1]
    return f"{words.found(d)}, P {d.probability:.2f}" + "".join(f"; {told}" for told in (values, *does) if told)


def _unknown(v: Verdict) -> str:
    told = f"{v.probability_unknown:.2f}"
    if v.unknown is None:
        return told
    where = ", ".join(filter(None, (words.joints_in_short(v.unknown.joints), v.unknown.regime)))
    depends = f"depends on {' and '.join(v.unknown.depends_on)}" if v.unknown.depends_on else ""
    more = ", ".join(filter(None, (where, depends)))
    return f"{told}: {more}" if more else told
