"""Write a run's tables as Parquet or CSV files, one a topic."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from numpy.typing import NDArray

from spot_log.read.flat_tables import Table, tables_of
from spot_log.read.run import Run
from spot_model.errors import BadInputError
from spot_model.io.whole import check_new, whole_folder

FORMATS: Final = ("parquet", "csv")


class ExportError(BadInputError):
    """A run cannot be exported as asked."""


def export_run(run: Run, directory: Path, file_format: str, topics: Sequence[str] | None = None) -> list[Path]:
    """Write one file a topic, and ``header.json``.

    Args:
        run: What to export.
        directory: Where to; made if need be.
        file_format: ``parquet`` (needs pyarrow) or ``csv``.
        topics: Which tables; all that have rows by default.

    Returns:
        The files written.

    Raises:
        ExportError: Format or topic unknown, or pyarrow is not installed. Nothing is written then.
        OutputExistsError: A file exists. Nothing is written then.
        OSError: A file cannot be written.
    """
    if file_format not in FORMATS:
        raise ExportError(f"format {file_format!r} is not known; allowed: {', '.join((*FORMATS, 'rosbag2'))}")
    tables = tables_of(run)
    for topic in topics or ():
        if topic not in tables:
            raise ExportError(f"topic {topic!r} is not in a log; allowed: {', '.join(tables)}")
    chosen = {name: table for name, table in tables.items() if (name in topics if topics else _n_rows(table))}
    names = [*(f"{name}.{file_format}" for name in chosen), "header.json"]
    check_new(*(directory / name for name in names))
    write = _write_csv if file_format == "csv" else _parquet_writer()
    header = json.dumps(asdict(run.header), indent=2, ensure_ascii=False) + "\n"
    with whole_folder(directory) as part:
        for name, table in chosen.items():
            write(table, part / f"{name}.{file_format}")
        (part / "header.json").write_text(header, encoding="utf-8")
    return [directory / name for name in names]


def _n_rows(table: Table) -> int:
    return len(next(iter(table.values())))


def _write_csv(table: Table, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(table)
        # repr of a Python float gives back the same number, so a CSV loses nothing.
        writer.writerows(zip(*(_cells(column) for column in table.values()), strict=True))


def _cells(column: NDArray[Any]) -> list[Any]:
    if column.dtype == bool:
        return [int(value) for value in column.tolist()]
    return list(column.tolist())


def _parquet_writer() -> Any:
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as error:
        raise ExportError(
            "format 'parquet' needs pyarrow: pip install 'spot-rl[report]', or use --format csv"
        ) from error

    def write(table: Table, path: Path) -> None:
        parquet.write_table(pa.table(dict(table)), path, compression="zstd")

    return write
