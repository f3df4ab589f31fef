"""Run a notebook from its first cell to its last, in this process, and store what its cells give.

python scripts/run_notebook.py examples/tour.ipynb

Outputs are the ones that Jupyter stores: printed text, and the last expression of a cell as text, and as HTML or SVG
where it has one. A tour needs no kernel for that, and so the project needs no Jupyter.
"""

from __future__ import annotations

import ast
import contextlib
import hashlib
import io
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

Output = dict[str, Any]
MADE_FROM = "outputs_of_source_sha256"
"""Key of the notebook's metadata: whose outputs are stored, so that a test notices a cell that was changed since."""
_KINDS = {"text/html": "_repr_html_", "image/svg+xml": "_repr_svg_"}


def lines_of(text: str) -> list[str]:
    """A text as a notebook keeps it: a list of lines with their ends."""
    return text.splitlines(keepends=True)


def digest_of(notebook: dict[str, Any]) -> str:
    """SHA-256 of all code of a notebook."""
    code = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    return hashlib.sha256("\0".join(code).encode()).hexdigest()


def run_cell(source: str, names: dict[str, Any], number: int) -> list[Output]:
    """Execute one cell in the names that the cells share; its outputs, as a notebook stores them."""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed, value = io.StringIO(), None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, f"<cell {number}>", "exec"), names)  # noqa: S102 - our own notebook
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), f"<cell {number}>", "eval"), names)  # noqa: S307
    outputs: list[Output] = []
    if printed.getvalue():
        outputs.append({"output_type": "stream", "name": "stdout", "text": lines_of(printed.getvalue())})
    if value is not None:
        data = {"text/plain": lines_of(repr(value)[:2000])}
        for kind, method in _KINDS.items():
            shown = getattr(value, method, lambda: None)()
            if shown is not None:
                data[kind] = lines_of(shown)
        outputs.append({"output_type": "execute_result", "execution_count": number, "metadata": {}, "data": data})
    return outputs


def run(notebook: dict[str, Any]) -> dict[str, Any]:
    """The notebook with new outputs; cells run in the current folder."""
    names: dict[str, Any] = {"__name__": "__main__"}
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for number, cell in enumerate(cells, 1):
        cell["outputs"] = run_cell("".join(cell["source"]), names, number)
        cell["execution_count"] = number
    notebook["metadata"][MADE_FROM] = digest_of(notebook)
    return notebook


def main() -> None:
    path = Path(sys.argv[1]).resolve()
    notebook = json.loads(path.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        text = json.dumps(run(notebook), indent=1, ensure_ascii=False) + "\n"
    path.write_text(text, encoding="utf-8")
    print(f"wrote {path}: {len(text) / 1000:.0f} kB")


if __name__ == "__main__":
    main()
