"""The results of a long bench on disk: a line of JSON each, below a first line that says what they are results of."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from spot_model.errors import BadInputError


class ResultFile:
    """Keeps each result as soon as it is there, so that an interrupted bench goes on where it was.

    Args:
        path: A new file, or one of an earlier part.
        head: What the results are of; those of something else are not continued.

    Raises:
        BadInputError: The file is of something else, or of no bench.
    """

    def __init__(self, path: Path, head: dict[str, Any]) -> None:
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(head) + "\n")
        first, *lines = path.read_text().splitlines() or ["{}"]
        self._path = path
        try:
            if json.loads(first) != head:
                raise BadInputError(f"{path} begins with {first:.120}, not {json.dumps(head)}; give another --out")
            self.earlier: list[dict[str, Any]] = [dict(json.loads(line)) for line in lines]
            """What was kept before, oldest first."""
        except (ValueError, TypeError) as error:
            raise BadInputError(f"{path} holds no results of this command ({error}); give another --out") from error

    def add(self, result: dict[str, Any]) -> None:
        """Keep one more."""
        with self._path.open("a") as file:
            file.write(json.dumps(result, ensure_ascii=False) + "\n")
