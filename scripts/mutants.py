"""Mutants of a source file: the file with one place changed.

What is changed: comparisons, arithmetic, and/or/not, numbers and truth values, conditions, returned values, keyword
arguments, min and max, any and all, and calls made for their effect. Words in messages are not changed.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

REPOSITORY = Path(__file__).resolve().parent.parent

COMPARE: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Pow: ast.Mult,
    ast.Mod: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
NAMES = {"min": "max", "max": "min", "any": "all", "all": "any", "minimum": "maximum", "maximum": "minimum"}


class Mutant(NamedTuple):
    """One changed place."""

    file: str
    line: int
    what: str
    node: int
    """The changed node's place in ``ast.walk``."""
    change: Callable[[Any], object]

    @property
    def source(self) -> str:
        """The text of the changed file."""
        tree = ast.parse((REPOSITORY / self.file).read_text(encoding="utf-8"))
        self.change(list(ast.walk(tree))[self.node])
        return ast.unparse(ast.fix_missing_locations(tree))


def mutants_of(file: str) -> Iterator[Mutant]:
    """Every mutant of a file."""
    tree = ast.parse((REPOSITORY / file).read_text(encoding="utf-8"))
    skipped = _unjudged(tree)
    for index, node in enumerate(ast.walk(tree)):
        if id(node) not in skipped:
            for what, change in _changes(node):
                yield Mutant(file, getattr(node, "lineno", 0), what, index, change)


def _unjudged(tree: ast.AST) -> set[int]:
    """Nodes that decide nothing: annotations, docstrings, texts for people, and ``strict``, which only asserts."""
    skipped: set[int] = set()
    for node in ast.walk(tree):
        parts: list[ast.AST | None] = []
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            parts += [node.returns, *(a.annotation for a in (*node.args.args, *node.args.kwonlyargs))]
            parts += node.decorator_list
        if isinstance(node, ast.AnnAssign):
            parts.append(node.annotation)
        if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.keyword) and node.arg == "strict"):
            parts.append(node)
        for part in parts:
            skipped |= {id(inner) for inner in ast.walk(part)} if part is not None else set()
    return skipped


def _changes(node: ast.AST) -> Iterator[tuple[str, Callable[[Any], object]]]:
    if isinstance(node, ast.Compare):
        for i, op in enumerate(node.ops):
            for other in COMPARE[type(op)]:
                yield f"{type(op).__name__} → {other.__name__}", _setter_at("ops", i, other())
    elif isinstance(node, (ast.BinOp, ast.AugAssign)) and type(node.op) in ARITHMETIC:
        other_op = ARITHMETIC[type(node.op)]
        yield f"{type(node.op).__name__} → {other_op.__name__}", _setter("op", other_op())
    elif isinstance(node, ast.BoolOp):
        other_bool = ast.Or if isinstance(node.op, ast.And) else ast.And
        yield f"{type(node.op).__name__} → {other_bool.__name__}", _setter("op", other_bool())
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.Not, ast.USub)):
        yield f"{type(node.op).__name__} removed", _setter("op", ast.UAdd() if isinstance(node.op, ast.USub) else None)
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield f"{node.value} → {not node.value}", _setter("value", not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        yield f"{node.value} → {node.value + 1}", _setter("value", node.value + 1)
    elif isinstance(node, ast.Name) and node.id in NAMES and isinstance(node.ctx, ast.Load):
        yield f"{node.id} → {NAMES[node.id]}", _setter("id", NAMES[node.id])
    elif isinstance(node, ast.Attribute) and node.attr in NAMES:
        yield f"{node.attr} → {NAMES[node.attr]}", _setter("attr", NAMES[node.attr])
    elif isinstance(node, (ast.If, ast.IfExp, ast.While)):
        yield "condition negated", lambda twin: setattr(twin, "test", ast.UnaryOp(ast.Not(), twin.test))
    elif isinstance(node, ast.Return) and node.value is not None and not _is_none(node.value):
        yield "returns None", _setter("value", ast.Constant(None))
    elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        yield "call left out", _setter("value", ast.Constant(None))
    if isinstance(node, ast.Call):
        for i, keyword in enumerate(node.keywords):
            if keyword.arg not in (None, "description", "default", "strict"):
                yield f"argument {keyword.arg} left out", lambda twin, at=i: twin.keywords.pop(at)


def _is_none(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


def _setter(name: str, value: object) -> Callable[[Any], object]:
    def change(twin: ast.AST) -> None:
        if value is None and isinstance(twin, ast.UnaryOp):
            twin.op, twin.operand = ast.Not(), ast.UnaryOp(ast.Not(), twin.operand)
        else:
            setattr(twin, name, value)

    return change


def _setter_at(name: str, index: int, value: object) -> Callable[[Any], object]:
    return lambda twin: getattr(twin, name).__setitem__(index, value)
