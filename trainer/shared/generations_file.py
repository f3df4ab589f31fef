"""The file of a search's finished generations, from which an interrupted search goes on."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from spot_model.errors import BadInputError


def read_or_begin(path: Path, head: dict[str, Any]) -> list[dict[str, Any]]:
    """The finished generations of a search; a file that is missing or empty is begun with ``head``.

    Args:
        path: One JSON object a line, the first of them the head.
        head: What the search is of; a file with another head belongs to another search.

    Raises:
        BadInputError: The file is damaged, or belongs to another search.
    """
    if not path.exists():
        append_line(path, head)
        return []
    lines = path.read_text(encoding="utf-8").split("\n")
    complete, torn = lines[:-1], lines[-1]
    if torn:
        # The process ended while it wrote this line; that generation is searched again.
        path.write_text("".join(f"{line}\n" for line in complete), encoding="utf-8")
    try:
        entries = [json.loads(line) for line in complete]
    except json.JSONDecodeError as error:
        raise BadInputError(f"checkpoint {path} is damaged: {error}; search in a new folder") from error
    if not entries:
        append_line(path, head)
        return []
    if entries[0] != head:
        what = [key for key in head if entries[0].get(key) != head[key]] if isinstance(entries[0], dict) else ["all"]
        raise BadInputError(
            f"checkpoint {path} belongs to another search ({', '.join(what)} differ); "
            "resume with the same logs and config, or search in a new folder"
        )
    return entries[1:]


def append_line(path: Path, data: dict[str, Any]) -> None:
    """Add one line and wait until it is on the disk."""
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(data) + "\n")
        file.flush()
        os.fsync(file.fileno())
