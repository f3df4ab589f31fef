"""Bring the tables in docs/runtime.md up to date with the code."""

from pathlib import Path

from spot_runtime.doctor.documentation_tables import with_tables

DOCUMENT = Path(__file__).parent.parent / "docs" / "runtime.md"

if __name__ == "__main__":
    DOCUMENT.write_text(with_tables(DOCUMENT.read_text(encoding="utf-8")), encoding="utf-8")
