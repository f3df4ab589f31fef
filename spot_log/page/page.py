"""One self-contained page of a run: opens from disk, needs no network, plotly.js inside once."""

from __future__ import annotations

import html
from pathlib import Path
from typing import Any, Final

from spot_log.page.errors import PlotlyMissingError, ReportError
from spot_log.page.summary import seconds_text, summary_lines
from spot_log.read.run import Run
from spot_log.tools.info import LogInfo, log_info

MAX_EVENT_ROWS: Final = 300
MAX_HEADER_TEXT: Final = 4000

_WINDOW: Final = "Four seconds of the run; double-click for all of it."
SECTIONS: Final = (
    ("velocity", "Velocity", "What was commanded and what the body did, in the body frame. Dotted: warnings, errors."),
    (
        "joints",
        "Joints",
        f"Measured position and the set-point that was sent. {_WINDOW}",
    ),
    ("loads", "Loads", "Measured torque of each joint; red: what the joint can give, for the knee at its position."),
    ("timing", "Timing", "One count a tick or command. Dotted: median and 99th percentile."),
    (
        "contacts",
        "Contacts",
        f"A bar while the foot is on the ground. {_WINDOW}",
    ),
    ("power", "Battery and temperatures", "Polled a few times a second."),
)
"""Name of the figure's function, heading, one line of explanation."""

_STYLE: Final = """
body { font: 15px/1.45 system-ui, sans-serif; color: #26313b; background: #f4f6f8; margin: 0; }
main { max-width: 1320px; margin: 0 auto; padding: 20px; }
h1 { font-size: 24px; margin: 4px 0 2px; } h2 { font-size: 18px; margin: 0 0 2px; }
section { background: #fff; border: 1px solid #dde3e8; border-radius: 8px; padding: 14px 18px; margin: 14px 0; }
p.note { color: #61707d; margin: 0 0 4px; font-size: 13px; }
table { border-collapse: collapse; width: 100%; font-size: 14px; }
td, th { text-align: left; vertical-align: top; padding: 3px 12px 3px 0; border-bottom: 1px solid #edf0f3; }
th { color: #61707d; font-weight: 500; white-space: nowrap; }
.bad { color: #b03030; font-weight: 600; } .warning { color: #9a6a00; } .error { color: #b03030; }
h1, td { overflow-wrap: anywhere; } section { overflow-x: auto; } .plotly-graph-div { min-width: 620px; }
pre { white-space: pre-wrap; word-break: break-word; margin: 0; font-size: 12px; max-height: 220px; overflow: auto; }
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

        from spot_log.page.figures import FIGURES
    except ModuleNotFoundError as error:
        raise PlotlyMissingError from error
    info = log_info(run)
    parts = [_summary_section(info)]
    for name, heading, note in SECTIONS:
        parts.append(_section(heading, note, _figure_div(name, FIGURES[name](run))))
    parts += [_section("Events", "", _events_table(info)), _section("Header", "", _header_table(info))]
    title = html.escape(f"{info.header['run_id'] or run.path.name}")
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{_STYLE}</style>'
        f"<script>{get_plotlyjs()}</script></head>\n<body><main><h1>Run {title}</h1>"
        f'<p class="note">{html.escape(run.path.name)}</p>\n' + "\n".join(parts) + "\n</main></body></html>\n"
    )


def _section(heading: str, note: str, body: str) -> str:
    told = f'<p class="note">{html.escape(note)}</p>' if note else ""
    return f"<section><h2>{html.escape(heading)}</h2>{told}{body}</section>"


def _figure_div(name: str, figure: Any) -> str:
    if figure is None:
        return '<p class="note">The log has no data for this.</p>'
    buttons = [["toImage", "zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "autoScale2d", "resetScale2d"]]
    config = {"displaylogo": False, "responsive": True, "modeBarButtons": buttons}
    return str(figure.to_html(full_html=False, include_plotlyjs=False, div_id=f"figure-{name}", config=config))


def _summary_section(info: LogInfo) -> str:
    rows = []
    for line in summary_lines(info):
        label, _, text = line.partition(" ")
        if label == "event":
            continue
        is_bad = label == "damaged" or (label == "falls" and bool(info.motion.falls))
        css = ' class="bad"' if is_bad else ""
        rows.append(f"<tr><th>{html.escape(label)}</th><td{css}>{html.escape(text.strip())}</td></tr>")
    return _section("Summary", "", f"<table>{''.join(rows)}</table>")


def _events_table(info: LogInfo) -> str:
    if not info.events:
        return '<p class="note">None.</p>'
    rows = []
    for event in info.events[:MAX_EVENT_ROWS]:
        values = ", ".join(f"{key} {value:g}" for key, value in event["values"].items())
        cells = (seconds_text(event["time_s"]), event["severity"], event["name"], event["text"], values)
        told = "".join(f"<td>{html.escape(cell)}</td>" for cell in cells)
        rows.append(f'<tr class="{html.escape(event["severity"])}">{told}</tr>')
    left = len(info.events) - MAX_EVENT_ROWS
    more = f'<p class="note">{left} more are in the log.</p>' if left > 0 else ""
    head = "<tr><th>time</th><th>severity</th><th>name</th><th>what</th><th>values</th></tr>"
    return f"<table>{head}{''.join(rows)}</table>{more}"


def _header_table(info: LogInfo) -> str:
    rows = []
    for key, value in info.header.items():
        text = html.escape(_words(value)[:MAX_HEADER_TEXT])
        if key.endswith("_json"):
            text = f"<pre>{text}</pre>"
        rows.append(f"<tr><th>{html.escape(key)}</th><td>{text}</td></tr>")
    return f"<table>{''.join(rows)}</table>"


def _words(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name}: {item}" for name, item in value.items())
    return ", ".join(value) if isinstance(value, tuple) else str(value)
