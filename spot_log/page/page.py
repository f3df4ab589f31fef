"""One self-contained page of a run: opens from disk, needs no network, light or dark."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from spot_log.format.events import EventName
from spot_log.page.figures import FIGURES
from spot_log.page.render import rendered
from spot_log.page.sections import Content, Fold, Head, Mark, Section, Table
from spot_log.page.summary import seconds_text, summary_lines
from spot_log.read.run import Run
from spot_log.tools.log_info import LogInfo, log_info
from spot_model.io.whole import check_new, write_new

MAX_EVENT_ROWS: Final = 300
_LOOKS: Final = {"error": "bad", "warning": "fair"}


def write_page(run: Run, path: str | Path) -> Path:
    """Write the page of a run. Raises OutputExistsError and OSError."""
    path = Path(path)
    check_new(path)
    write_new(path, page_html(run))
    return path


def page_html(run: Run) -> str:
    """The whole page as text."""
    info = log_info(run)
    told = _summary(info)
    no_data = Mark("The log has no data for this.", "note")
    parts = [
        _head(info, told),
        *(Section(f.heading, f.note, f.draw(run) or no_data) for f in FIGURES.values()),
        Section("Events", "", _events(info)),
        Section("Summary", "What 'spot-rl log info' prints.", Table((), told.items())),
        Section("Header", "", Fold("What the log says of itself", Table((), _header(info)))),
    ]
    return rendered(_title(info), parts)


def _title(info: LogInfo) -> str:
    header, distance = info.header, info.motion.distance_m
    what = f"{header['policy_name'] or 'No policy'}, {header['command_sequence'] or 'steered by hand'}"
    walked = f"{distance:.1f} m in " if math.isfinite(distance) else ""
    return f"{what}: {walked}{info.motion.control_s:.0f} s"


def _head(info: LogInfo, told: dict[str, str]) -> Head:
    falls = info.motion.falls or []
    doubts = [event["text"] for event in info.events if event["name"] == EventName.IMPORT_DOUBTED.label]
    is_error = any(event["severity"] == "error" and not _is_wish(event) for event in info.events)
    faults = ((info.damage, "Log damaged"), (doubts, "Import doubted"), (falls, "Fell"), (is_error, "Errors"))
    badge = next((name for found, name in faults if found), "No fault")
    lines = [f"Ended: {info.outcome}.", *info.damage, *doubts, f"{told['motion'][:1].upper()}{told['motion'][1:]}."]
    walked = dict.fromkeys(span.gait.name for span in info.gaits if span.gait.name not in ("none", "stand"))
    lines += [f"Gait: {', '.join(walked)}."] if walked else []
    lines += [f"Falls: {told['falls']}."] if falls else []
    header = info.header
    meta = f"robot {header['robot_id'] or 'unnamed'} · repeat {header['repeat']} · {Path(info.file).name}"
    return Head(badge, "good" if badge == "No fault" else "bad", _title(info), lines, meta)


def _is_wish(event: dict[str, Any]) -> bool:
    """Whether a stop is the operator's, which is no fault."""
    return bool(event["name"] == "stop" and event["text"].startswith("operator_stop"))


def _summary(info: LogInfo) -> dict[str, str]:
    """What there is to say by its label; the gait's rows under one label."""
    told: dict[str, str] = {}
    for line in summary_lines(info):
        label, _, text = line.partition(" ")
        if label != "event":
            told[label] = f"{told[label]}\n{text.strip()}" if label in told else text.strip()
    return told


def _events(info: LogInfo) -> Content:
    shown, rows = info.events[:MAX_EVENT_ROWS], []
    for event in shown:
        values = ", ".join(f"{key} {value:g}" for key, value in event["values"].items())
        rows.append((seconds_text(event["time_s"]), event["severity"], event["name"], event["text"], values))
    left = len(info.events) - MAX_EVENT_ROWS
    more = f"{left} more are in the log." if left > 0 else "" if shown else "None."
    looks = ["" if _is_wish(event) else _LOOKS.get(event["severity"], "") for event in shown]
    return [Table(("time", "severity", "name", "what", "values"), rows, looks), Mark(more, "note")]


def _header(info: LogInfo) -> Iterator[tuple[str, Mark | str]]:
    for key, value in info.header.items():
        parts = tuple(f"{name}: {item}" for name, item in value.items()) if isinstance(value, dict) else value
        text = (", ".join(parts) if isinstance(parts, tuple) else str(parts))[:4000]
        yield key, Mark(text, "pre") if key.endswith("_json") else text
