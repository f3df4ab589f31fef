"""The verdict in about twelve lines: the page's words and figures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from diagnosis.document import Difference, Verdict
from diagnosis.report import words
from diagnosis.report.headline import headline

MOST: Final = 3
"""Differences that are told; the page has all."""


def twelve_lines(verdict: Verdict, paths: Mapping[str, Path]) -> list[str]:
    """The lines for a terminal."""
    v = verdict
    used = sum(s == "used" for s in v.channels.values())
    splits = [d.split.command for d in v.differences if d.split is not None]
    lines = [
        *(("warning", w) for w in v.warnings),
        ("verdict", v.headline or headline(v)),
        ("logs", f"{len(v.logs)}; {used} of {len(v.channels)} channels can be used"),
        *([("difference", _difference(d)) for d in v.differences[:MOST]] or [("difference", "none is shown")]),
        ("otherwise", words.otherwise(v)),
        ("unknown", words.unknown_phrase(v.unknown) if v.unknown is not None else ""),
        ("calibration", words.own_phrase(v)),
        ("held", "; ".join(v.held)),
        ("corrected", "; ".join(map(words.gap_phrase, words.all_gaps(v))) or "not measured"),
        ("remains", "; ".join(map(words.left_phrase, v.remainder))),
        ("invisible", ", ".join(map(words.plain_name, v.invisible))),
        ("to decide", "".join(splits[:1])),
        ("advice", "".join(v.log_advice[:1])),
        ("model", str(paths.get("model", v.no_model or "-"))),
        ("report", str(paths.get("report", "-"))),
    ]
    return [f"{name:<12}{told}" for name, told in lines if told]


def _difference(d: Difference) -> str:
    values = ", ".join(words.size_phrase(name, p) for name, p in d.parameters.items())
    told = (f"{words.found(d)}, P {d.probability:.2f}", values, words.does(d.consequences))
    return "; ".join(filter(None, told))
