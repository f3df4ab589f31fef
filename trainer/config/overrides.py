"""``--set key.path=value``: changes to a config's data before it is checked."""

from __future__ import annotations

import copy
import difflib
from typing import Any

import yaml
from pydantic import BaseModel

from spot_model.errors import BadInputError


def apply_overrides(data: dict[str, Any], overrides: tuple[str, ...], model: type[BaseModel]) -> dict[str, Any]:
    """A copy of ``data`` with each override set; values are YAML, so lists and numbers work.

    A path may leave out ``task.`` in front of a task's key: ``rewards.gait=5`` means ``task.rewards.gait=5``.

    Raises:
        BadInputError: An override has no ``=``, no valid value, or names a key that does not exist.
    """
    result = copy.deepcopy(data)
    for override in overrides:
        path, separator, text = override.partition("=")
        if not separator:
            raise BadInputError(f"override {override!r} has no '='; allowed: key.path=value")
        try:
            value = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise BadInputError(f"override {override!r}: its value is no YAML: {error}") from error
        _set(result, resolve_path(path.strip(), model), value)
    return result


def resolve_path(path: str, model: type[BaseModel]) -> tuple[str, ...]:
    """The keys that ``path`` names, from the root.

    Raises:
        BadInputError: There is no such key; the message lists those that are allowed.
    """
    parts = tuple(path.split("."))
    if parts[0] not in allowed_keys(model, ()) and parts[0] in allowed_keys(model, ("task",)):
        parts = ("task", *parts)
    for depth, key in enumerate(parts):
        allowed = allowed_keys(model, parts[:depth])
        if ":" in path and path.endswith(".".join(parts[depth:])) and takes_more_keys(model, parts[:depth]):
            return (*parts[:depth], ".".join(parts[depth:]))
        if not allowed:
            raise BadInputError(f"key {path!r}: {'.'.join(parts[:depth])} has no keys below it; set it as a whole")
        if key not in allowed:
            close = difflib.get_close_matches(key, allowed, n=1)
            hint = f"did you mean {close[0]!r}? " if close else ""
            raise BadInputError(f"key {path!r}: {key!r} is unknown; {hint}allowed: {', '.join(allowed)}")
    return parts


def allowed_keys(model: type[BaseModel], path: tuple[str, ...]) -> list[str]:
    """Keys below ``path``; empty where a plain value stands."""
    below = _model_at(model, path)
    return [] if below is None else [field.alias or name for name, field in below.model_fields.items()]


def takes_more_keys(model: type[BaseModel], path: tuple[str, ...]) -> bool:
    """Whether what stands at ``path`` takes keys of the form ``module:function`` beside its own."""
    below = _model_at(model, path)
    return below is not None and below.model_config.get("extra") == "allow"


def _model_at(model: type[BaseModel], path: tuple[str, ...]) -> type[BaseModel] | None:
    for key in path:
        field = {f.alias or name: f for name, f in model.model_fields.items()}.get(key)
        annotation = field.annotation if field is not None else None
        if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
            return None
        model = annotation
    return model


def _set(data: dict[str, Any], path: tuple[str, ...], value: Any) -> None:
    *parents, last = path
    for key in parents:
        data = data.setdefault(key, {})
        if not isinstance(data, dict):
            raise BadInputError(f"key {'.'.join(path)!r}: {key!r} holds {data!r}; allowed: a mapping of keys")
    data[last] = value
