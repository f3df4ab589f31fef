"""docs/reference/verdict.md: what verdict.json holds, as far as the Python reference does not describe it."""

from __future__ import annotations

import typing
from typing import Any

from pydantic import BaseModel

from diagnosis.document import Verdict

from .python_api import ARRAYS
from .words import attribute_docs, is_part, page, plain, table, type_words

ABOUT = """\
`spot-rl diagnose` writes `verdict.json`. In Python, `spot_rl.diagnose` returns it as an object whose attributes are the
keys of the file, so most parts are described in the [Python reference](python.md). For the method and its terms, see
[diagnose](../diagnosis.md). Its JSON Schema is printed by

```sh
python -c "import json; from diagnosis.document import Verdict; print(json.dumps(Verdict.model_json_schema()))"
```"""


def verdict_page() -> str:
    """The page."""
    described = {cls: where for where, cls in ARRAYS}
    models = _models(Verdict)
    rows = [(f"`{m.__name__}`", plain(m.__doc__ or ""), _link(described[m])) for m in models if m in described]
    sections = [_section(model) for model in models if model not in described]
    return page("verdict.json", ABOUT, [table(("part", "what it is", "its keys"), rows), *sections])


def _link(where: str) -> str:
    """The heading of the Python reference; that of the verdict itself is its second one."""
    anchor = "".join(c for c in where.lower() if c.isalnum() or c in " _-").replace(" ", "-")
    return f"[{where}](python.md#{'verdict_1' if anchor == 'verdict' else anchor})"


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
