"""The frozen protocol: a digest over all that decides a verdict, fixed before a scored run."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any, Final

import diagnosis
import withheld
from diagnosis.library.registry import LIBRARY

SOURCES: Final = ("*.py", "*.json")


def protocol_digest() -> str:
    """SHA-256 over the diagnosis' sources, its calibration and the library's bounds; hexadecimal."""
    h = hashlib.sha256(_folder(Path(diagnosis.__file__).parent))
    h.update(json.dumps(library_bounds(), sort_keys=True).encode())
    return h.hexdigest()


def generator_digest() -> str:
    """SHA-256 over the sources that draw and make the cases; hexadecimal."""
    root = Path(withheld.__file__).parent
    h = hashlib.sha256()
    for part in ("cases.py", "sequences.py", "plan.py", "realities"):
        path = root / part
        h.update(_folder(path) if path.is_dir() else path.read_bytes() if path.exists() else b"")
    return h.hexdigest()


def library_bounds() -> dict[str, Any]:
    """Bounds of all parameters and coefficients by effect; they lie partly outside of the diagnosis' own sources."""
    return {
        name: {
            "parameters": [[p.name, repr(p.low), repr(p.high), repr(p.null)] for p in entry.effect.parameters()],
            "coefficients": [[c.name, repr(c.low), repr(c.high)] for c in entry.coefficients],
        }
        for name, entry in LIBRARY.items()
    }


def _folder(folder: Path) -> bytes:
    h = hashlib.sha256()
    files = sorted({p for pattern in SOURCES for p in folder.rglob(pattern)}, key=lambda p: p.relative_to(folder).parts)
    for path in files:
        h.update(f"{path.relative_to(folder).as_posix()}\n{path.stat().st_size}\n".encode())
        h.update(path.read_bytes())
    return h.digest()
