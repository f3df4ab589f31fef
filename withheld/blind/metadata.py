"""All that can be known of a case's folder without reading a signal: a classifier on it has to be at chance."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
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


def _digest(*parts: object) -> float:
    """Return a number that differs where the parts do."""
    return float(int(hashlib.sha256("".join(map(str, parts)).encode()).hexdigest()[:8], 16))


OF_A_RUN: Final[Mapping[str, Callable[[Run], float]]] = {
    "states": lambda r: len(r.states),
    "commands": lambda r: len(r.commands),
    "ticks": lambda r: len(r.ticks),
    "polls": lambda r: len(r.slow_states),
    "events": lambda r: len(r.events),
    "damage": lambda r: len(r.damage),
    "run id": lambda r: _digest(r.header.run_id),
    "labels and config": lambda r: _digest(
        (r.header.labels, r.header.config_json, r.header.robot_id, r.header.adapter)
    ),
    "version": lambda r: _digest(r.header.software_version, r.header.software_revision),
    "began": lambda r: r.header.started_host_stamp_ns % 10**15,
    "first state": lambda r: int(r.states.robot_stamp_ns[0]) % 10**12 if len(r.states) else 0,
    "length": lambda r: float(np.ptp(r.states.robot_stamp_ns)) if len(r.states) else 0,
}
"""What is known of each run; of a case, its mean and its spread."""


def features(folder: Path, runs: Sequence[Run], without: Sequence[str]) -> dict[str, float]:
    """Return numbers by name.

    Args:
        folder: As the diagnosing process sees it.
        runs: Its logs; only their headers, stamps and counts are looked at.
        without: Effects that are left out of the library.
    """
    files = sorted(p for p in folder.rglob("*") if p.is_file() and p.suffix in (".mcap", ".yaml"))
    sizes, ages = np.array([(p.stat().st_size, p.stat().st_mtime) for p in files], dtype=np.float64).T
    names = [p.stem for p in files if p.suffix == ".mcap"]
    found = {
        "files": len(files),
        "bytes, least": sizes.min(),
        "bytes, most": sizes.max(),
        "bytes, mean": sizes.mean(),
        "age, s": ages.mean(),
        "age spread, s": np.ptp(ages),
        "name": np.mean([_digest(name) for name in names]),
        "name as number": np.mean([_hexadecimal(name[:6]) for name in names]),
        "model file": _digest(*(p.read_text(encoding="utf-8") for p in files if p.suffix == ".yaml")),
        "left out of the library": _digest(",".join(without)),
        "count left out": len(without),
    }
    for name, of in OF_A_RUN.items():
        values = [float(of(run)) for run in runs]
        found |= {f"{name}, mean": np.mean(values), f"{name}, spread": np.ptp(values)}
    return {name: float(value) for name, value in found.items()}


def _hexadecimal(text: str) -> int:
    try:
        return int(text, 16)
    except ValueError:
        return -1
