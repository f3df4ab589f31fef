"""What files of settings are read into: unknown keys are refused, nothing changes later, and NaN is no number."""

from __future__ import annotations

import typing
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError


class Settings(BaseModel):
    """A part of such a file."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True, allow_inf_nan=False)


def positive(default: float, most: float, description: str | None = None) -> Any:
    """A number above 0 and at most ``most``, with its default and what it means."""
    return Field(default=default, gt=0.0, le=most, description=description)


def between(default: float, least: float, most: float, description: str | None = None) -> Any:
    """A number from ``least`` to ``most``, with its default and what it means."""
    return Field(default=default, ge=least, le=most, description=description)


def explain(error: ValidationError, model: type[BaseModel] | None = None) -> str:
    """One line a problem: the key's path, the value that was given, and what is wrong or allowed.

    With the ``model`` that was validated, an unknown key comes with the keys that are allowed at its place.
    """
    lines = []
    for problem in error.errors(include_url=False):
        where = ".".join(str(part) for part in problem["loc"]) or "file"
        value = "" if problem["type"] == "missing" else f" = {_short(problem['input'])}"
        message = problem["msg"].removeprefix("Value error, ")
        if problem["type"] == "value_error" and not problem["loc"]:
            where = value = ""  # of several keys, which the message names
        if problem["type"] == "extra_forbidden":
            message = "unknown key"
            allowed = _keys_at(model, problem["loc"][:-1]) if model is not None else ()
            message += f"; allowed: {', '.join(allowed)}" if allowed else ""
        elif problem["type"] in ("model_type", "dict_type"):
            message = "allowed: keys with values, 'key: value'"
        lines.append(f"  {where}{value}: {message}" if where else f"  {message}")
    return "\n".join(lines)


def _short(value: object, limit: int = 80) -> str:
    text = repr(value)
    return text if len(text) <= limit else f"{text[: limit - 1]}…"


def _keys_at(model: type[BaseModel], path: tuple[int | str, ...]) -> tuple[str, ...]:
    """Names of the keys that the part of ``model`` at ``path`` knows; none where the path leaves plain models."""
    here: list[type[BaseModel]] = [model]
    for part in path:
        found = [_models_in(m.model_fields[str(part)].annotation) for m in here if str(part) in m.model_fields]
        tagged = [m for m in here if any(f.default == part for f in m.model_fields.values())]
        here = [m for group in found for m in group] if found else tagged or here
    return tuple(dict.fromkeys(f.alias or name for m in here for name, f in m.model_fields.items()))


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in typing.get_args(annotation) for model in _models_in(part)]
