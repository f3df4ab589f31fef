"""The notebook runs, finds what its robot hides, and its stored outputs are of the same kinds."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from runpy import run_path
from typing import Any

import pytest

from .conftest import REPOSITORY

pytestmark = pytest.mark.slow

NOTEBOOK = REPOSITORY / "examples" / "tour.ipynb"
SCRIPT = REPOSITORY / "scripts" / "run_notebook.py"
MOST_BYTES = 400_000
AGAIN = "run scripts/run_notebook.py examples/tour.ipynb"


def code_of(notebook: dict[str, Any]) -> list[dict[str, Any]]:
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def kinds_of(cell: dict[str, Any]) -> list[Any]:
    """What each output of a cell is: printed, or a value with its forms."""
    return [(output["output_type"], sorted(output.get("data", {}))) for output in cell["outputs"]]


def words_of(cell: dict[str, Any]) -> str:
    """All that a cell says, pictures left out."""
    texts = [output.get("text", output.get("data", {}).get("text/plain", [])) for output in cell["outputs"]]
    return "".join("".join(text) for text in texts)


def labels_of(cell: dict[str, Any]) -> list[str]:
    """Names of rows and columns of a table; numbers differ from computer to computer, and a picture has no table."""
    is_table = any("text/html" in output.get("data", {}) for output in cell["outputs"])
    return re.findall(r"[A-Za-z_][\w.%]*", words_of(cell)) if is_table else []


def test_the_tour_gives_outputs_like_those_that_are_stored(tmp_path: Path) -> None:
    stored = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert stored["nbformat"] == 4
    copy = tmp_path / "tour.ipynb"
    copy.write_bytes(NOTEBOOK.read_bytes())
    told = subprocess.run([sys.executable, str(SCRIPT), str(copy)], cwd=tmp_path, capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    fresh = json.loads(copy.read_text(encoding="utf-8"))
    for old, new in zip(code_of(stored), code_of(fresh), strict=True):
        assert kinds_of(new) == kinds_of(old), AGAIN
        assert labels_of(new) == labels_of(old)
    assert "completed" in words_of(code_of(fresh)[0])
    assert "dry friction" in " ".join(map(words_of, code_of(fresh)))


def test_outputs_are_stored_of_this_code_with_plots_and_small() -> None:
    script, stored = run_path(str(SCRIPT)), json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert stored["metadata"][script["MADE_FROM"]] == script["digest_of"](stored), (
        "run scripts/run_notebook.py examples/tour.ipynb"
    )
    kinds = [kind for cell in code_of(stored) for _, forms in kinds_of(cell) for kind in forms]
    assert kinds.count("image/svg+xml") >= 2
    assert NOTEBOOK.stat().st_size < MOST_BYTES
    assert "dry friction" in " ".join(map(words_of, code_of(stored)))
