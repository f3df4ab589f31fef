"""The table within docs/method/safety-checks.md: the bounds of the safety core with their derivations."""

from __future__ import annotations

import ast
import inspect
import itertools
from collections.abc import Iterator
from types import ModuleType

from spot_runtime.control.safety import battery, states
from spot_runtime.control.safety.signals import bounds

from .words import plain, table

BEGIN, END = "<!-- bounds: written by scripts/write_docs.py -->", "<!-- end of bounds -->"


def safety_page(text: str) -> str:
    """The page with its table as it should be now."""
    head, _, rest = text.partition(BEGIN)
    return f"{head}{BEGIN}\n\n{bounds_table()}\n{END}{rest.partition(END)[2]}"


def bounds_table() -> str:
    """Every constant of the plausibility checks with its derivation."""
    rows = [row for module in (bounds, states, battery) for row in _constants(module)]
    return table(("bound", "value", "derivation"), rows)


def _constants(module: ModuleType) -> Iterator[tuple[str, str, str]]:
    """A module's public constants with the strings that stand below them."""
    body = ast.parse(inspect.getsource(module)).body
    for statement, following in itertools.pairwise([*body, ast.Pass()]):
        if not (isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name)):
            continue
        name, text = statement.target.id, ""
        if name.startswith("_"):
            continue
        if isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant):
            text = plain(str(following.value.value))
        value = getattr(module, name)
        words = " to ".join(f"{v:g}" for v in value) if isinstance(value, tuple) else f"{value:g}"
        yield f"`{name}`", words, text or "–"
