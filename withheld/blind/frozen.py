"""The frozen protocol: digests over all that decides a verdict, fixed before a scored run."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Final

SOURCES: Final = ("*.py", "*.json")
ROOT: Final = Path(__file__).resolve().parent.parent.parent
DIAGNOSES: Final = ("diagnosis", "spot_model", "trainer/sysid")
GENERATES: Final = ("withheld/plan.py", "withheld/cases", "withheld/realities", "withheld/simulator")


def protocol_digest() -> str:
    """SHA-256 over the sources of the diagnosis, its constants and the effects that it knows; hexadecimal."""
    return _digest(DIAGNOSES)


def generator_digest() -> str:
    """SHA-256 over the sources that draw and make the cases; hexadecimal."""
    return _digest(GENERATES)


def _digest(parts: tuple[str, ...]) -> str:
    h = hashlib.sha256()
    for part in parts:
        path = ROOT / part
        h.update(_folder(path) if path.is_dir() else path.read_bytes())
    return h.hexdigest()


def _folder(folder: Path) -> bytes:
    h = hashlib.sha256()
    files = sorted({p for pattern in SOURCES for p in folder.rglob(pattern)}, key=lambda p: p.relative_to(folder).parts)
    for path in files:
        h.update(f"{path.relative_to(folder).as_posix()}\n{path.stat().st_size}\n".encode())
        h.update(path.read_bytes())
    return h.digest()
