"""Keep logs within a quota by deleting the oldest closed ones."""

from __future__ import annotations

import contextlib
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from spot_log.errors import ASIDE_SUFFIX
from spot_model.errors import BadInputError

GB = 1e9
SUFFIX = ".mcap"
KEEP_SUFFIX = ".keep"
"""``run.mcap.keep`` beside ``run.mcap`` exempts it."""


@dataclass(frozen=True)
class LogFile:
    """A closed log, with the damaged file that it was recovered from, if that was kept."""

    path: Path
    size_bytes: int
    changed_ns: int


def prune_logs(
    folder: Annotated[Path, typer.Argument(help="Folder of the logs, without its subfolders.")],
    quota_gb: Annotated[float, typer.Option(min=0.0, help="Largest total size of the logs, GB.")],
    min_free_gb: Annotated[float, typer.Option(min=0.0, help="Free space to keep on the disk, GB.")] = 0.0,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only list what would be deleted.")] = False,
) -> None:
    """Delete the oldest logs of a folder until they fit a quota; open logs and those marked .keep are kept."""
    if not folder.is_dir():
        raise BadInputError(f"log folder {folder} is no folder; name the one that logs are written to")
    logs = closed_logs(folder)
    free_bytes = shutil.disk_usage(folder).free
    surplus = to_delete(logs, quota_bytes=quota_gb * GB, missing_bytes=min_free_gb * GB - free_bytes)
    for log in surplus:
        if not dry_run:
            log.path.unlink(missing_ok=True)
            _damaged(log.path).unlink(missing_ok=True)
        typer.echo(f"{'would delete' if dry_run else 'deleted'} {log.path} ({log.size_bytes / GB:.3f} GB)")
    gone_bytes = sum(log.size_bytes for log in surplus)
    left_gb = (sum(log.size_bytes for log in logs) - gone_bytes) / GB
    typer.echo(f"{len(logs) - len(surplus)} logs, {left_gb:.3f} GB, free {(free_bytes + gone_bytes) / GB:.1f} GB")


def closed_logs(folder: Path) -> list[LogFile]:
    """The closed logs of a folder that may be deleted, oldest first. A link is none."""
    found = []
    for path in folder.glob(f"*{SUFFIX}"):
        if path.is_symlink() or not path.is_file() or path.with_name(path.name + KEEP_SUFFIX).exists():
            continue
        with contextlib.suppress(FileNotFoundError):  # somebody else has deleted it just now
            status = path.stat()
            damaged_bytes = sum(p.stat().st_size for p in [_damaged(path)] if p.is_file())
            found.append(LogFile(path, status.st_size + damaged_bytes, status.st_mtime_ns))
    return sorted(found, key=lambda log: (log.changed_ns, log.path.name))


def _damaged(path: Path) -> Path:
    """What a log was recovered from, where that was kept beside it."""
    return path.with_name(path.name + ASIDE_SUFFIX)


def to_delete(logs: list[LogFile], *, quota_bytes: float, missing_bytes: float) -> list[LogFile]:
    """The oldest logs that must go, oldest first, so that at most ``quota_bytes`` stay and the disk lacks no room."""
    over_bytes = max(sum(log.size_bytes for log in logs) - quota_bytes, missing_bytes)
    chosen = []
    for log in logs:
        if over_bytes <= 0:
            break
        chosen.append(log)
        over_bytes -= log.size_bytes
    return chosen
