"""``history.html`` and ``history.json``: a robot's dated diagnoses on one page. Both are derived, and written anew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from diagnosis.report import words
from diagnosis.report.drift import Drift, Track, drift_of, of_place
from diagnosis.report.history import day_of, read_history
from diagnosis.report.output import NAMES
from spot_log.page.chart import Series, chart
from spot_log.page.look import Html, boxed, framed, headed, listed, table
from spot_log.page.svg import esc
from spot_model.io.whole import write_over
from spot_model.text import counted

PAGE: Final = "history.html"
DATA: Final = "history.json"
MOST_CHARTS: Final = 12
MOST_COLUMNS: Final = 4
"""Numbers that have a column in the table of dates."""
OUTCOMES: Final = {"unchanged": "no change shown", "unknown_effect": "something unknown", "changed": "changed"}
STYLE: Final = """
.calibration { background: #2f6fb5; } .unchanged { background: #2f6fb5; } .changed { background: #b7791f; }
.charts { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(330px, 100%), 1fr)); gap: 12px 18px; }
td a { white-space: nowrap; }
"""


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
    badge = OUTCOMES.get(drift.outcome, last.status.replace("_", " ")).capitalize()
    meta = f"robot {drift.robot or 'without a serial number'} · {counted(len(drift.dates), 'date')}, "
    meta += f"{drift.dates[0].date} to {last.date}"
    changed = [t for t in drift.tracks if t.is_named or t.has_changed]
    body = [
        headed(badge, drift.outcome, lead, drift.since_last[1:], meta),
        boxed("Since the first date", drift.dates[0].date, listed(drift.since_first)),
        boxed(
            "What changed",
            "Numbers in which the first and the last date differ significantly, or that a date names. Bars are 90 % "
            "intervals. Where there is only a dotted line, the model holds a number that the date did not measure.",
            _charts(changed, at),
        ),
        boxed("Dates", "", _dates(drift, changed or drift.tracks)),
    ]
    return framed("Has it changed?", body, STYLE)


def _places(drift: Drift) -> dict[str, float]:
    """Days since the first date, by name; diagnoses of one day lie side by side within it."""
    days = [day_of(d.date) for d in drift.dates]
    return {
        d.date: (day - days[0]).days + days[:i].count(day) / days.count(day)
        for i, (d, day) in enumerate(zip(drift.dates, days, strict=True))
    }


def _charts(tracks: Sequence[Track], at: Mapping[str, float]) -> str:
    drawn = "".join(f"<div>{_chart(t, at)}</div>" for t in tracks[:MOST_CHARTS])
    return f"<div class='charts'>{drawn}</div>" if drawn else ""


def _chart(track: Track, at: Mapping[str, float]) -> str:
    """A number over the days, with whiskers."""
    points = track.points
    x, y = [at[p.date] for p in points], [p.value for p in points]
    lines = [Series("var(--other)", x, y, width=1.2, is_dotted=True)]
    for place, p in zip(x, points, strict=True):
        if p.low is not None and p.high is not None:
            lines.append(Series("var(--corrected)", [place, place], [p.low, p.high], width=3))
            name = f"{track.title}{of_place(track)}, {p.date}:"
            lines.append(Series("var(--corrected)", [place], [p.value], has_points=True, name=name))
    unit = f", {track.unit}" if track.unit else ""
    title = f"{track.title}{of_place(track)}{unit}"
    first = min(at, key=lambda date: at[date])
    return chart(lines, title=title, x_title=f"days since {first}", width=400, height=130)


def _dates(drift: Drift, tracks: Sequence[Track]) -> Html:
    """A row each date: its verdict, and the numbers that changed most."""
    columns = tracks[:MOST_COLUMNS]
    head = ("date", "verdict", "compared with", *(f"{t.title}{of_place(t)}" for t in columns))
    rows = [
        (
            Html(f"<a href='{esc(d.date)}/{NAMES['report']}'>{esc(d.date)}</a>"),
            d.headline,
            d.since or d.nominal,
            *(words.number(p.value, t.unit, p.low, p.high) if (p := t.at(d.date)) else "—" for t in columns),
        )
        for d in reversed(drift.dates)
    ]
    return table(head, rows)
