"""A ledger: JSON lines, each with the hash of the one before, so that nothing can be put in or changed afterwards."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from spot_model.errors import SpotRlError

GENESIS: Final = "0" * 64
ORDER: Final = ("sealed", "verdict", "opened")
"""What happens to each case, in this order."""


class LedgerError(SpotRlError):
    """A ledger is damaged, or tells of things in an order that proves nothing."""


@dataclass(frozen=True)
class Entry:
    """One line."""

    event: str
    data: dict[str, Any]
    previous: str
    hash: str


class Ledger:
    """Appends to a file; every line is on disk before :meth:`add` returns."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._last = read_ledger(path)[-1].hash if path.exists() and path.stat().st_size else GENESIS

    def add(self, event: str, **data: Any) -> Entry:
        """Append a line."""
        entry = Entry(event, data, self._last, _hash(event, data, self._last))
        line = {"event": event, "data": data, "previous": entry.previous, "hash": entry.hash}
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line, sort_keys=True) + "\n")
            file.flush()
            os.fsync(file.fileno())
        self._last = entry.hash
        return entry


def read_ledger(path: Path) -> list[Entry]:
    """All lines, checked.

    Raises:
        LedgerError: A line does not follow from the one before.
    """
    entries: list[Entry] = []
    last = GENESIS
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            data = json.loads(line)
            entry = Entry(data["event"], data["data"], data["previous"], data["hash"])
        except (json.JSONDecodeError, KeyError, TypeError) as error:
            raise LedgerError(f"{path}, line {number}: no entry: {error}") from error
        if entry.previous != last or entry.hash != _hash(entry.event, entry.data, last):
            raise LedgerError(f"{path}, line {number}: its hash does not follow from the line before; it was changed")
        last = entry.hash
        entries.append(entry)
    return entries


def check_order(entries: list[Entry], path: Path) -> dict[str, Entry]:
    """The entries of one case by event.

    Raises:
        LedgerError: One is missing, there twice, or the seal came after the verdict.
    """
    events = tuple(e.event for e in entries if e.event in ORDER)
    if events != ORDER:
        raise LedgerError(f"{path}: events {', '.join(events) or 'none'}; allowed: {', '.join(ORDER)}, in this order")
    return {e.event: e for e in entries if e.event in ORDER}


def _hash(event: str, data: dict[str, Any], previous: str) -> str:
    text = json.dumps([previous, event, data], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()
