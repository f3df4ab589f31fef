"""A sealed truth, and the ledger that shows when it was sealed, when the verdict came, and when it was opened."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from spot_model.errors import SpotRlError
from withheld.plan import Truth

LEDGER: Final = "ledger.jsonl"
GENESIS: Final = "0" * 64
ORDER: Final = ("sealed", "verdict", "opened")
"""What happens to each case, in this order."""


class SealError(SpotRlError):
    """What was opened is not what was sealed."""


class LedgerError(SpotRlError):
    """A ledger is damaged, or tells of things in an order that proves nothing."""


@dataclass(frozen=True)
class Seal:
    """A truth that only this process holds; nothing but :attr:`digest` may leave it before the verdict."""

    nonce: str
    """Hexadecimal, from the operating system: without it nobody can try truths until one fits the digest."""
    text: str

    @staticmethod
    def of(truth: Truth) -> Seal:
        """Seal a truth."""
        return Seal(secrets.token_hex(32), truth.model_dump_json())

    @property
    def digest(self) -> str:
        """SHA-256 over the nonce, a line feed, and the text; hexadecimal."""
        return hashlib.sha256(f"{self.nonce}\n{self.text}".encode()).hexdigest()

    def opened(self, digest: str) -> Truth:
        """Return the truth, if it is the one that was sealed.

        Raises:
            SealError: Its digest is another one.
        """
        if self.digest != digest:
            raise SealError(
                f"the truth's digest is {self.digest}, the sealed one was {digest}; it was changed after the verdict"
            )
        return Truth.model_validate_json(self.text)


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file, hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


@dataclass(frozen=True)
class Entry:
    """One line of a ledger, with the hash of the one before: nothing can be put in or changed afterwards."""

    event: str
    data: dict[str, Any]
    previous: str
    hash: str


def enter(path: Path, event: str, **data: Any) -> None:
    """Append a line to a ledger; it is on disk when this returns."""
    entries = read_ledger(path) if path.exists() else []
    previous = entries[-1].hash if entries else GENESIS
    entry = Entry(event, data, previous, _hash(event, data, previous))
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(asdict(entry), sort_keys=True) + "\n")
        file.flush()
        os.fsync(file.fileno())


def read_ledger(path: Path) -> list[Entry]:
    """Return all lines, checked.

    Raises:
        LedgerError: A line does not follow from the one before.
    """
    entries: list[Entry] = []
    last = GENESIS
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            entry = Entry(**json.loads(line))
        except (json.JSONDecodeError, TypeError) as error:
            raise LedgerError(f"{path}, line {number}: no entry: {error}") from error
        if entry.previous != last or entry.hash != _hash(entry.event, entry.data, last):
            raise LedgerError(f"{path}, line {number}: its hash does not follow from the line before; it was changed")
        last = entry.hash
        entries.append(entry)
    return entries


def read_case_ledger(path: Path) -> dict[str, Entry]:
    """Return the entries of one case by event.

    Raises:
        LedgerError: One is missing, there twice, or the seal came after the verdict.
    """
    entries = read_ledger(path)
    events = tuple(e.event for e in entries)
    if events != ORDER:
        raise LedgerError(f"{path}: events {', '.join(events) or 'none'}; allowed: {', '.join(ORDER)}, in this order")
    return {e.event: e for e in entries}


def _hash(event: str, data: dict[str, Any], previous: str) -> str:
    return hashlib.sha256(json.dumps([previous, event, data], sort_keys=True).encode()).hexdigest()
