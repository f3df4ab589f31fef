"""One self-contained page of a run: opens from disk, needs no network, plotly.js inside once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from spot_log.page.cells import Html, escaped, facts, note, table
from spot_log.page.errors import PlotlyMissingError, ReportError
from spot_log.page.look import boxed, framed
from spot_log.page.summary import seconds_text, summary_lines
from spot_log.read.run import Run
from spot_log.tools.info import LogInfo
from spot_log.tools.log_info import log_info

MAX_EVENT_ROWS: Final = 300
MAX_HEADER_TEXT: Final = 4000
STYLE: Final = """
.alarm, tr.error td { color: var(--bad); } tr.warning td { color: var(--warn); }
.plotly-graph-div { min-width: 620px; } td { overflow-wrap: anywhere; } pre { max-height: 220px; overflow: auto; }
"""


def write_page(run: Run, path: str | Path) -> Path:
    """Write the page of a run.

    Raises:
        ReportError: The page exists already, or plotly is not installed.
        OSError: The page cannot be written.
    """
    path = Path(path)
    if path.exists():
        raise ReportError(f"page {path} exists already; pages are never overwritten: choose another name")
    text = page_html(run)
    with path.open("x", encoding="utf-8") as file:
        file.write(text)
    return path


def page_html(run: Run) -> str:
    """The whole page as text.

    Raises:
        PlotlyMissingError: plotly is not installed.
    """
    try:
        from plotly.offline import get_plotlyjs

        from spot_log.page.draw import plot
        from spot_log.page.figures import FIGURES
    except ModuleNotFoundError as error:
        raise PlotlyMissingError from error
    info = log_info(run)
    title = f"Run {info.header['run_id'] or run.path.name}"
    parts = [f"<h1>{escaped(title)}</h1>{note(run.path.name)}", boxed("Summary", "", facts(_summary(info)))]
    parts += [boxed(f.heading, f.note, plot(f.draw(run), name)) for name, f in FIGURES.items()]
    parts += [boxed("Events", "", _events(info)), boxed("Header", "", facts(_header(info)))]
    return framed(title, parts, STYLE, f"<script>{get_plotlyjs()}</script>")


def _summary(info: LogInfo) -> Iterator[tuple[str, str]]:
    for line in summary_lines(info):
        label, _, text = line.partition(" ")
        if label != "event":
            is_bad = label == "damaged" or (label == "falls" and bool(info.motion.falls))
            yield label, Html(f'<b class="alarm">{escaped(text.strip())}</b>') if is_bad else text.strip()


def _events(info: LogInfo) -> str:
    if not info.events:
        return note("None.")
    shown = info.events[:MAX_EVENT_ROWS]
    rows = []
    for event in shown:
        values = ", ".join(f"{key} {value:g}" for key, value in event["values"].items())
        rows.append((seconds_text(event["time_s"]), event["severity"], event["name"], event["text"], values))
    left = len(info.events) - MAX_EVENT_ROWS
    more = note(f"{left} more are in the log." if left > 0 else "")
    head = ("time", "severity", "name", "what", "values")
    return table(head, rows, row_classes=[event["severity"] for event in shown]) + more


def _header(info: LogInfo) -> Iterator[tuple[str, str]]:
    for key, value in info.header.items():
        text = _words(value)[:MAX_HEADER_TEXT]
        yield key, Html(f"<pre>{escaped(text)}</pre>") if key.endswith("_json") else text


def _words(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name}: {item}" for name, item in value.items())
    return ", ".join(value) if isinstance(value, tuple) else str(value)
