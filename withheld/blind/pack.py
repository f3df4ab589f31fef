"""One file with all of a run but its reports: what a machine without a network hands back."""

from __future__ import annotations

import tarfile
from pathlib import Path
from typing import Final

from spot_model.errors import BadInputError
from withheld.blind.run_folder import RUN, SEED_FILE

KEPT: Final = ("outcome.json", "verdict.json", "ledger.jsonl", "corrected_model.yaml")


def pack(out: Path, file: Path, most_mib: float) -> int:
    """Write a ``.tar.gz``; returns its cases. Unpacked it is a run's folder that can be scored and resumed.

    Raises:
        BadInputError: The file exists, or is larger than ``most_mib``.
    """
    if file.exists():
        raise BadInputError(f"{file} exists; choose another name")
    folders = sorted(p.parent for p in (out / "cases").glob("*/outcome.json"))
    with tarfile.open(file, "w:gz", compresslevel=9) as archive:
        for path in (out / RUN, out / SEED_FILE, out / "ledger.jsonl", out / "scores.json"):
            if path.exists():
                archive.add(path, path.name)
        for folder in folders:
            for name in KEPT:
                if (folder / name).exists():
                    archive.add(folder / name, f"cases/{folder.name}/{name}")
    size = file.stat().st_size / 2**20
    if size > most_mib:
        raise BadInputError(f"{file} has {size:.1f} MiB; allowed: {most_mib:g} (--most-mib)")
    return len(folders)
