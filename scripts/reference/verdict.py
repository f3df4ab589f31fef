"""docs/reference/verdict.md: what verdict.json holds."""

from __future__ import annotations

import typing
from typing import Any

from pydantic import BaseModel

from diagnosis.document import Verdict

from .words import attribute_docs, is_part, page, plain, table, type_words

ABOUT = """\
`spot-rl diagnose` writes `verdict.json`; in Python, `spot_rl.diagnose` returns it as an object with the same
attributes. The JSON Schema is `diagnosis/verdict.schema.json`. For the method and its terms, see
[diagnose](../diagnosis.md)."""


def verdict_page() -> str:
    """The page."""
    return page("verdict.json", ABOUT, [_section(model) for model in _models(Verdict)])


def _models(root: type[BaseModel]) -> list[type[BaseModel]]:
    found = [root]
    for model in found:
        for field in model.model_fields.values():
            found += [m for m in _inside(field.annotation) if m not in found]
    return found


def _inside(annotation: Any) -> list[type[BaseModel]]:
    if is_part(annotation):
        return [annotation]
    return [m for arg in typing.get_args(annotation) for m in _inside(arg)]


def _section(model: type[BaseModel]) -> str:
    docs = attribute_docs(model)
    rows = [
        (f"`{field.alias or name}`", type_words(field.annotation), field.description or docs.get(name, ""))
        for name, field in model.model_fields.items()
    ]
    return f"## {model.__name__}\n\n{plain(model.__doc__ or '')}\n\n{table(('key', 'type', 'meaning'), rows)}"
