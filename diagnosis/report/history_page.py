"""``history.html`` and ``history.json``: a robot's dated diagnoses on one page. Both are derived, and written anew."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from diagnosis.report import words
from diagnosis.report.drift import Drift, Key, called, drift_of
from diagnosis.report.history import read_history
from diagnosis.report.output import NAMES
from diagnosis.report.page import BADGES
from spot_log.page.render import rendered
from spot_log.page.sections import Beside, Chart, Head, Items, Mark, Section, Series, Table
from spot_model.io.whole import write_over
from spot_model.text import counted

PAGE: Final = "history.html"
DATA: Final = "history.json"
MOST_CHARTS: Final = 12
MOST_COLUMNS: Final = 4
"""Numbers that have a column in the table of dates."""
OUTCOMES: Final = {
    "unchanged": ("No change shown", "none"),
    "unknown_effect": ("Something unknown", "unknown"),
    "changed": ("Changed", "fair"),
}
"""A word and its kind, of several dates."""


def write_history(folder: Path) -> tuple[Drift, Path]:
    """Read a history, and write its page and its data.

    Returns:
        What the page says, and its place.

    Raises:
        BadInputError: One of the diagnoses is not whole.
    """
    drift = drift_of(read_history(folder))
    write_over(folder / DATA, drift.to_json())
    write_over(folder / PAGE, history_page(drift))
    return drift, folder / PAGE


def history_page(drift: Drift) -> str:
    """The page as text."""
    first, last = drift.rows[0].dated, drift.rows[-1].dated
    lead = drift.since_last[0] if drift.since_last else last.verdict.headline
    meta = f"robot {drift.robot or 'without a serial number'} · {counted(len(drift.rows), 'date')}, "
    meta += f"{first.name} to {last.name}"
    about = (
        "Numbers in which the first and the last date differ significantly, or that a date names. Bars are 90 % "
        "intervals. Where there is only a dotted line, the model holds a number that the date did not measure."
    )
    parts = [
        Head(*(BADGES | OUTCOMES)[drift.outcome], lead, drift.since_last[1:], meta),
        Section("Since the first date", first.name, Items(drift.since_first)),
        Section("What changed", about, Beside([_chart(drift, key) for key in drift.changed[:MOST_CHARTS]], 3)),
        Section("Dates", "", _dates(drift, (drift.changed or tuple(drift.rows[-1].numbers))[:MOST_COLUMNS])),
    ]
    return rendered("Has it changed?", parts)


def _chart(drift: Drift, key: Key) -> Chart:
    """A number over the days, with whiskers; diagnoses of one day lie side by side within it."""
    days = [row.dated.day for row in drift.rows]
    at = [(day - days[0]).days + days[:i].count(day) / days.count(day) for i, day in enumerate(days)]
    found = [(x, row.dated.name, n) for x, row in zip(at, drift.rows, strict=True) if (n := row.numbers.get(key))]
    name, unit = called(key, found[-1][2]), found[-1][2].unit
    lines = [
        Series("var(--other)", [x for x, _, _ in found], [n.value for _, _, n in found], width=1.2, is_dotted=True)
    ]
    for x, date, n in found:
        if n.low is not None and n.high is not None:
            lines.append(Series("var(--corrected)", [x, x], [n.low, n.high], width=3))
            lines.append(Series("var(--corrected)", [x], [n.value], has_points=True, name=f"{name}, {date}:"))
    title = f"{name}, {unit}" if unit else name
    return Chart(lines, title=title, x_title=f"days since {drift.rows[0].dated.name}", height=130)


def _dates(drift: Drift, keys: Sequence[Key]) -> Table:
    """A row each date: its verdict, and some numbers."""
    newest = {key: n for row in drift.rows for key, n in row.numbers.items()}
    head = ("date", "verdict", "compared with", *(called(key, newest[key]) for key in keys))
    rows = []
    for row in reversed(drift.rows):
        v, found = row.dated.verdict, [row.numbers.get(key) for key in keys]
        told = ("—" if n is None else words.number(n.value, n.unit, n.low, n.high) for n in found)
        day = Mark(row.dated.name, "number", f"{row.dated.name}/{NAMES['report']}")
        rows.append((day, v.headline, v.since or v.nominal, *told))
    return Table(head, rows)
