"""One file with all of a run but its reports: what a machine without a network hands back."""

from __future__ import annotations

import tarfile
from pathlib import Path
from typing import Final

from spot_model.errors import BadInputError
from spot_model.io.whole import check_new, whole_file
from withheld.blind.run_folder import RUN, SEED_FILE

KEPT: Final = ("outcome.json", "verdict.json", "ledger.jsonl", "corrected_model.yaml")


def pack(out: Path, file: Path, most_mib: float) -> int:
    """Write a ``.tar.gz``; returns its cases. Unpacked it is a run's folder that can be scored and resumed.

    Raises:
        OutputExistsError: The file exists.
        BadInputError: It would be larger than ``most_mib``; nothing is written.
    """
    check_new(file)
    folders = sorted(p.parent for p in (out / "cases").glob("*/outcome.json"))
    with whole_file(file) as part:
        with tarfile.open(part, "w:gz", compresslevel=9) as archive:
            for path in (out / RUN, out / SEED_FILE, out / "ledger.jsonl", out / "scores.json"):
                if path.exists():
                    archive.add(path, path.name)
            for folder in folders:
                for name in KEPT:
                    if (folder / name).exists():
                        archive.add(folder / name, f"cases/{folder.name}/{name}")
        size = part.stat().st_size / 2**20
        if size > most_mib:
            raise BadInputError(f"{file} would have {size:.1f} MiB; allowed: {most_mib:g} (--most-mib)")
    return len(folders)
