"""The house as ARCHITECTURE.md draws it: folders that one can take in at a glance, arrows without a circle."""

from __future__ import annotations

import ast
import subprocess
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = (
    "spot_model",
    "spot_log",
    "spot_runtime",
    "spot_rl",
    "fake_robot",
    "trainer",
    "diagnosis",
    "proof",
    "withheld",
)
MOST_ENTRIES = 14
REBUILT_NOW = {"diagnosis", "withheld", "fake_robot"}
"""Packages in which entries or arrows are still being put in order; this set may only shrink."""
CHECKED = [pytest.param(p, marks=pytest.mark.xfail(strict=False)) if p in REBUILT_NOW else p for p in PACKAGES]
NO_ENTRIES = {"__init__.py", "__main__.py", "py.typed"}


@cache
def sources(package: str) -> tuple[Path, ...]:
    listed = subprocess.run(["git", "ls-files", package], cwd=ROOT, capture_output=True, text=True, check=True)
    return tuple(ROOT / line for line in listed.stdout.split("\n") if line.endswith(".py") and (ROOT / line).exists())


def modules_imported(source: str) -> Iterator[str]:
    """Every module that a file imports, also within functions."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def room(package: str, module: str) -> str | None:
    """The sub-package of a module, or the module itself where it lies at the package's root."""
    parts = module.split(".")
    if parts[0] != package or len(parts) < 2:
        return None
    inside = ROOT / package / parts[1]
    return parts[1] if inside.is_dir() or inside.with_suffix(".py").exists() else None


def arrows(package: str) -> dict[str, set[str]]:
    found: dict[str, set[str]] = {}
    for path in sources(package):
        parts = path.relative_to(ROOT).with_suffix("").parts
        if len(parts) < 2 or parts[1] in {"__init__", "__main__"}:
            continue
        to = {room(package, module) for module in modules_imported(path.read_text(encoding="utf-8"))}
        found.setdefault(parts[1], set()).update(name for name in to if name and name != parts[1])
    return found


def circle(graph: dict[str, set[str]]) -> list[str]:
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


@pytest.mark.parametrize("package", CHECKED)
def test_arrows_between_sub_packages_have_no_circle(package: str) -> None:
    assert circle(arrows(package)) == []


def test_a_circle_would_be_found() -> None:
    assert set(circle({"a": {"b"}, "b": {"c"}, "c": {"a"}})) == {"a", "b", "c"}
    assert circle({"a": {"b", "c"}, "b": {"c"}}) == []
    assert set(modules_imported("def f():\n    from a.b import c\nimport d.e")) == {"a.b", "a.b.c", "d.e"}


@pytest.mark.parametrize("package", CHECKED)
def test_no_folder_has_more_entries_than_one_takes_in_at_a_glance(package: str) -> None:
    entries: dict[str, set[str]] = {}
    for path in sources(package):
        below = path.relative_to(ROOT)
        for parent in list(below.parents)[:-1]:
            entries.setdefault(str(parent), set()).add(below.relative_to(parent).parts[0])
    crowded = {folder: len(names - NO_ENTRIES) for folder, names in entries.items()}
    assert {folder: n for folder, n in crowded.items() if n > MOST_ENTRIES} == {}
