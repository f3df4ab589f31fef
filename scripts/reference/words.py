"""What the generated pages share: cells of tables, types as words, and what the source says of attributes."""

from __future__ import annotations

import ast
import inspect
import itertools
import textwrap
import typing
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

NOTE = "<!-- written by scripts/write_docs.py; change the code, then run 'make docs' -->\n\n"


def page(title: str, about: str, parts: Iterable[str]) -> str:
    """A whole page."""
    return f"# {title}\n\n{NOTE}{about}\n\n" + "\n".join(part.rstrip() + "\n" for part in parts if part)


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown; empty where there are no rows."""
    lines = ["| " + " | ".join(cell(c) for c in row) + " |" for row in rows]
    if not lines:
        return ""
    return "\n".join(["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads), *lines]) + "\n"


def cell(text: str) -> str:
    """Text for one cell of a table."""
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;")


def plain(text: str) -> str:
    """A docstring as Markdown: one blank-line paragraph stays one, references of Sphinx become code."""
    joined = inspect.cleandoc(text)
    for role in (":class:", ":func:", ":meth:", ":data:", ":mod:", ":attr:"):
        joined = joined.replace(role, "")
    return joined.replace("``", "`").replace("`~", "`")


def attribute_docs(cls: type) -> dict[str, str]:
    """The strings that stand below attributes in a class's source, by attribute; inherited ones too."""
    docs: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        try:
            tree = ast.parse(textwrap.dedent(inspect.getsource(base)))
        except (OSError, TypeError):
            continue
        body = tree.body[0].body if isinstance(tree.body[0], ast.ClassDef) else []
        for statement, following in itertools.pairwise(body):
            is_text = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
            if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name) and is_text:
                value = following.value.value
                if isinstance(value, str):
                    docs[statement.target.id] = plain(value)
    return docs


def keys_table(model: type[BaseModel]) -> str:
    """Every key of a part of a file: type, default, bounds and meaning; keys that are parts themselves are left out."""
    docs = attribute_docs(model)
    rows = []
    for name, field in model.model_fields.items():
        if is_part(field.annotation) or name == "schema_name":
            continue
        meaning = " ".join(w for w in (plain(field.description or docs.get(name, "")), _bounds(field.metadata)) if w)
        rows.append((f"`{field.alias or name}`", type_words(field.annotation), default_words(field), meaning))
    return table(("key", "type", "default", "meaning"), rows)


def is_part(annotation: Any) -> bool:
    """Whether a key holds keys of its own."""
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def parts_of(model: type[BaseModel], path: str = "") -> Iterator[tuple[str, type[BaseModel]]]:
    """The parts of a file with their paths, depth first; those in lists and mappings, too."""
    for name, field in model.model_fields.items():
        held = typing.get_args(field.annotation) if typing.get_origin(field.annotation) in (tuple, dict) else ()
        for part in filter(is_part, (field.annotation, *held)):
            here = f"{path}.{field.alias or name}".lstrip(".")
            yield here, part
            yield from parts_of(part, here)


def default_words(field: Any) -> str:
    """A default as a file would hold it."""
    if field.default is PydanticUndefined and field.default_factory is None:
        return "required"
    value = field.default_factory() if field.default is PydanticUndefined else field.default
    if value in (None, "", (), {}):
        return "–"
    if isinstance(value, BaseModel):
        value = value.model_dump(mode="json", exclude_defaults=True) or value.model_dump(mode="json")
    if isinstance(value, tuple) and value and isinstance(value[0], (dict, BaseModel)):
        return f"{len(value)} entries"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f"`{list(value) if isinstance(value, tuple) else value}`"


def type_words(annotation: Any) -> str:
    """A type as a person says it."""
    names = {float: "number", int: "whole number", str: "text", bool: "true, false", Any: "value"}
    names |= {Path: "path", type(None): "nothing"}
    if annotation in names:
        return names[annotation]
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return type_words(arguments[0])
    if origin is typing.Literal:
        return ", ".join(map(str, arguments))
    if origin is dict:
        return "mapping"
    words = [type_words(arg) for arg in arguments if arg is not Ellipsis]
    if origin in (tuple, list):
        if words and isinstance(arguments[0], type) and issubclass(arguments[0], BaseModel):
            return f"list of `{words[0]}`"
        return f"list of {words[0]}s" if words else "list"
    return " or ".join(dict.fromkeys(words)) if words else getattr(annotation, "__name__", str(annotation))


def _bounds(metadata: Sequence[Any]) -> str:
    signs = (("gt", ">"), ("ge", "≥"), ("lt", "<"), ("le", "≤"))
    found = [
        f"{sign} {value:g}"
        for constraint in metadata
        for name, sign in signs
        if isinstance(value := getattr(constraint, name, None), (int, float))
    ]
    return f"({', '.join(found)})" if found else ""


def sections(model: type[BaseModel], level: str = "##") -> list[str]:
    """The keys of a file and of its parts, each part under its own heading."""
    found = [keys_table(model)]
    for path, part in parts_of(model):
        found += [f"{level} {path}\n\n{plain(part.__doc__ or '')}\n", keys_table(part)]
    return found
