"""All that can be known of a case's folder without reading a signal: a classifier on it has to be at chance."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from spot_log import Run

PAD_BYTES: Final = 4 << 20


def make_alike(logs: Path) -> None:
    """Bring every log to a multiple of 4 MiB; a reader stops at the end of the data, the size tells nothing then."""
    for path in logs.glob("*.mcap"):
        size = path.stat().st_size
        with path.open("r+b") as file:
            file.truncate(-(-size // PAD_BYTES) * PAD_BYTES)


def features(folder: Path, runs: Sequence[Run], without: Sequence[str]) -> dict[str, float]:
    """Numbers by name.

    Args:
        folder: As the diagnosing process sees it.
        runs: Its logs; only their headers, stamps and counts are looked at.
        without: Effects that are left out of the library.
    """
    files = sorted(p for p in folder.rglob("*") if p.is_file() and p.suffix in (".mcap", ".yaml"))
    sizes = np.array([p.stat().st_size for p in files], dtype=np.float64)
    logs = [p for p in files if p.suffix == ".mcap"]
    found: dict[str, float] = {
        "files": float(len(files)),
        "bytes, least": float(sizes.min()),
        "bytes, most": float(sizes.max()),
        "bytes, mean": float(sizes.mean()),
        "age, s": float(np.mean([p.stat().st_mtime for p in files])),
        "age spread, s": float(np.ptp([p.stat().st_mtime for p in files])),
        "name": float(np.mean([int(hashlib.sha256(p.name.encode()).hexdigest()[:6], 16) for p in logs])),
        "name as number": float(np.mean([int(p.stem[:6], 16) if _is_hex(p.stem[:6]) else -1 for p in logs])),
        "model file": _number(next((p.read_text(encoding="utf-8") for p in files if p.suffix == ".yaml"), "")),
        "left out of the library": _number(",".join(without)),
        "count left out": float(len(without)),
    }
    for name, values in _of_runs(runs).items():
        found[f"{name}, mean"] = float(np.mean(values))
        found[f"{name}, spread"] = float(np.ptp(values))
    return found


def _of_runs(runs: Sequence[Run]) -> dict[str, list[float]]:
    return {
        "states": [float(len(r.states)) for r in runs],
        "commands": [float(len(r.commands)) for r in runs],
        "ticks": [float(len(r.ticks)) for r in runs],
        "polls": [float(len(r.slow_states)) for r in runs],
        "events": [float(len(r.events)) for r in runs],
        "damage": [float(len(r.damage)) for r in runs],
        "run id": [_number(r.header.run_id) for r in runs],
        "labels and config": [
            _number(repr((r.header.labels, r.header.config_json, r.header.robot_id, r.header.adapter))) for r in runs
        ],
        "version": [_number(r.header.software_version + r.header.software_revision) for r in runs],
        "began": [float(r.header.started_host_stamp_ns % 10**15) for r in runs],
        "first state": [float(r.states.robot_stamp_ns[0] % 10**12) if len(r.states) else 0.0 for r in runs],
        "length": [float(np.ptp(r.states.robot_stamp_ns)) if len(r.states) else 0.0 for r in runs],
    }


def _number(text: str) -> float:
    return float(int(hashlib.sha256(text.encode()).hexdigest()[:8], 16))


def _is_hex(text: str) -> bool:
    return all(c in "0123456789abcdef" for c in text) and bool(text)
