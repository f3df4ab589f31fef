"""One self-contained page of a run: opens from disk, needs no network, light or dark."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from spot_log.format.events import EventName
from spot_log.page.figures import FIGURES, Figure
from spot_log.page.look import Html, boxed, escaped, facts, folded, framed, headed, note, table
from spot_log.page.summary import seconds_text, summary_lines
from spot_log.read.run import Run
from spot_log.tools.log_info import LogInfo, log_info
from spot_model.io.whole import check_new, write_new

MAX_EVENT_ROWS: Final = 300
MAX_HEADER_TEXT: Final = 4000
_MORE: Final = """
tr.error td { color: var(--bad); } tr.warning td { color: var(--warn); } pre { max-height: 220px; overflow: auto; }
td { overflow-wrap: anywhere; min-width: 76px; } th + td:last-child, td:nth-child(4) { min-width: 160px; }
td:nth-child(3) { min-width: 90px; }
"""


def write_page(run: Run, path: str | Path) -> Path:
    """Write the page of a run.

    Raises:
        OutputExistsError: The page exists already.
        OSError: The page cannot be written.
    """
    path = Path(path)
    check_new(path)
    write_new(path, page_html(run))
    return path


def page_html(run: Run) -> str:
    """The whole page as text."""
    info = log_info(run)
    told = dict(_summary(info))
    parts = [_head(info, told)]
    parts += [_section(f, run) for f in FIGURES.values()]
    parts += [
        boxed("Events", "", _events(info)),
        boxed("Summary", "What 'spot-rl log info' prints.", facts(told.items())),
        boxed("Header", "", folded("What the log says of itself", facts(_header(info)))),
    ]
    return framed(_title(info), parts, _MORE)


def _title(info: LogInfo) -> str:
    header, distance = info.header, info.motion.distance_m
    what = f"{header['policy_name'] or 'No policy'}, {header['command_sequence'] or 'steered by hand'}"
    walked = f"{distance:.1f} m in " if math.isfinite(distance) else ""
    return f"{what}: {walked}{info.motion.control_s:.0f} s"


def _head(info: LogInfo, told: dict[str, str]) -> str:
    falls = info.motion.falls or []
    doubts = [event["text"] for event in info.events if event["name"] == EventName.IMPORT_DOUBTED.label]
    if info.damage:
        badge, kind = "Log damaged", "bad"
    elif doubts:
        badge, kind = "Import doubted", "bad"
    elif falls:
        badge, kind = "Fell", "bad"
    elif any(event["severity"] == "error" and not _is_wish(event) for event in info.events):
        badge, kind = "Errors", "bad"
    else:
        badge, kind = "No fault", "good"
    lines = [f"Ended: {info.outcome}.", *info.damage, *doubts, f"{told['motion'][:1].upper()}{told['motion'][1:]}."]
    walked = dict.fromkeys(span.gait.name for span in info.gaits if span.gait.name not in ("none", "stand"))
    lines += [f"Gait: {', '.join(walked)}."] if walked else []
    lines += [f"Falls: {told['falls']}."] if falls else []
    header = info.header
    meta = f"robot {header['robot_id'] or 'unnamed'} · repeat {header['repeat']} · {Path(info.file).name}"
    return headed(badge, kind, _title(info), lines, meta)


def _is_wish(event: dict[str, Any]) -> bool:
    """Whether a stop is the operator's, which is no fault."""
    return bool(event["name"] == "stop" and event["text"].startswith("operator_stop"))


def _section(figure: Figure, run: Run) -> str:
    return boxed(figure.heading, figure.note, figure.draw(run) or note("The log has no data for this."))


def _summary(info: LogInfo) -> Iterator[tuple[str, str]]:
    """Labels and what there is to say; the gait's rows under one label."""
    rows: dict[str, list[str]] = {}
    for line in summary_lines(info):
        label, _, text = line.partition(" ")
        if label != "event":
            rows.setdefault(label, []).append(text.strip())
    for label, texts in rows.items():
        yield label, texts[0] if len(texts) == 1 else Html("<br>".join(map(escaped, texts)))


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
    return table(head, rows, row_classes=["info" if _is_wish(event) else event["severity"] for event in shown]) + more


def _header(info: LogInfo) -> Iterator[tuple[str, str]]:
    for key, value in info.header.items():
        text = _words(value)[:MAX_HEADER_TEXT]
        yield key, Html(f"<pre>{escaped(text)}</pre>") if key.endswith("_json") else text


def _words(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name}: {item}" for name, item in value.items())
    return ", ".join(value) if isinstance(value, tuple) else str(value)
