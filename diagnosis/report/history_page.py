"""``history.html`` and ``history.json``: a robot's dated diagnoses on one page. Both are derived, and written anew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from diagnosis.report import words
from diagnosis.report.drift import Drift, NumberHistory, drift_of, of_place
from diagnosis.report.history import day_of, read_history
from diagnosis.report.output import NAMES
from diagnosis.report.page import BADGES
from spot_log.page.render import rendered
from spot_log.page.sections import Beside, Chart, Head, Items, Mark, Section, Series, Table
from spot_model.io.whole import write_over
from spot_model.text import counted

PAGE: Final = "history.html"
DATA: Final = "history.json"
MOST_COLUMNS: Final = 4
"""Numbers that have a column in the table of dates."""
OUTCOMES: Final = {
    "unchanged": ("No change shown", "none"),
    "unknown_effect": ("Something unknown", "unknown"),
    "changed": ("Changed", "fair"),
    **BADGES,
}
"""A word and its kind."""


def write_history(folder: Path) -> tuple[Drift, Path]:
    """Read a history, and write its page and its data.

    Returns:
        What the page says, and its place.

    Raises:
        BadInputError: One of the diagnoses is not whole.
    """
    drift = drift_of(read_history(folder))
    write_over(folder / DATA, drift.model_dump_json(by_alias=True, indent=1) + "\n")
    write_over(folder / PAGE, history_page(drift))
    return drift, folder / PAGE


def history_page(drift: Drift) -> str:
    """The page as text."""
    last, at = drift.dates[-1], _places(drift)
    lead = drift.since_last[0] if drift.since_last else last.headline
    meta = f"robot {drift.robot or 'without a serial number'} · {counted(len(drift.dates), 'date')}, "
    meta += f"{drift.dates[0].date} to {last.date}"
    changed = [t for t in drift.tracks if t.is_named or t.has_changed]
    about = (
        "Numbers in which the first and the last date differ significantly, or that a date names. Bars are 90 % "
        "intervals. Where there is only a dotted line, the model holds a number that the date did not measure."
    )
    parts = [
        Head(*OUTCOMES.get(drift.outcome, BADGES[last.status]), lead, drift.since_last[1:], meta),
        Section("Since the first date", drift.dates[0].date, Items(drift.since_first)),
        Section("What changed", about, Beside([_chart(t, at) for t in changed[:12]], 3)),
        Section("Dates", "", _dates(drift, changed or drift.tracks)),
    ]
    return rendered("Has it changed?", parts)


def _places(drift: Drift) -> dict[str, float]:
    """Days since the first date, by name; diagnoses of one day lie side by side within it."""
    days = [day_of(d.date) for d in drift.dates]
    return {
        d.date: (day - days[0]).days + days[:i].count(day) / days.count(day)
        for i, (d, day) in enumerate(zip(drift.dates, days, strict=True))
    }


def _chart(track: NumberHistory, at: Mapping[str, float]) -> Chart:
    """A number over the days, with whiskers."""
    points, name = track.points, f"{track.title}{of_place(track)}"
    x, y = [at[p.date] for p in points], [p.value for p in points]
    lines = [Series("var(--other)", x, y, width=1.2, is_dotted=True)]
    for place, p in zip(x, points, strict=True):
        if p.low is not None and p.high is not None:
            lines.append(Series("var(--corrected)", [place, place], [p.low, p.high], width=3))
            lines.append(Series("var(--corrected)", [place], [p.value], has_points=True, name=f"{name}, {p.date}:"))
    title = f"{name}, {track.unit}" if track.unit else name
    return Chart(lines, title=title, x_title=f"days since {min(at, key=lambda date: at[date])}", height=130)


def _dates(drift: Drift, tracks: Sequence[NumberHistory]) -> Table:
    """A row each date: its verdict, and the numbers that changed most."""
    columns = tracks[:MOST_COLUMNS]
    head = ("date", "verdict", "compared with", *(f"{t.title}{of_place(t)}" for t in columns))
    rows = [
        (
            Mark(d.date, "number", f"{d.date}/{NAMES['report']}"),
            d.headline,
            d.since or d.nominal,
            *(words.number(p.value, t.unit, p.low, p.high) if (p := t.at(d.date)) else "—" for t in columns),
        )
        for d in reversed(drift.dates)
    ]
    return Table(head, rows)
