"""Finding an effect by name: the built-in ones, installed plug-ins, and ``module:Class``."""

from __future__ import annotations

import importlib
import pkgutil
from importlib.metadata import entry_points
from types import ModuleType
from typing import Any

import spot_model.effects
from spot_model.effects.base import Effect
from spot_model.errors import BadInputError
from spot_model.user_code import users_code

ENTRY_POINT_GROUP = "spot_rl.effects"


def effects_in(package: ModuleType) -> dict[str, type[Effect]]:
    """Every effect that a module of the package defines, by name: a new class is a new effect.

    Raises:
        ValueError: Two classes have the same name.
    """
    found: dict[str, type[Effect]] = {}
    for info in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        # The one import by name in the project: it stays inside the package, so no layer is passed.
        module = importlib.import_module(info.name)  # noqa: TID251
        for cls in vars(module).values():
            if not (isinstance(cls, type) and issubclass(cls, Effect) and cls.__module__ == module.__name__):
                continue
            if "name" in vars(cls):
                if cls.name in found:
                    raise ValueError(f"effect {cls.name!r} is defined by {found[cls.name].__module__} and {info.name}")
                found[cls.name] = cls
    return found


BUILT_IN: dict[str, type[Effect]] = effects_in(spot_model.effects)


def effect_class(name: str) -> type[Effect]:
    """The effect class called ``name``: built in, of an installed plug-in, or ``module:Class``.

    Raises:
        BadInputError: There is none, or it is not an effect.
    """
    if name in BUILT_IN:
        return BUILT_IN[name]
    plugins = {entry.name: entry for entry in entry_points(group=ENTRY_POINT_GROUP)}
    if name in plugins:
        with users_code(f"effect {name!r}", "mend or uninstall the package that brings it"):
            return _checked(name, plugins[name].load())
    if ":" in name:
        advice = "check the names of module and class, and that the module's folder is on PYTHONPATH, in full"
        if name.startswith("__main__:"):
            advice = "a script's own class is not found by other programs: put it into a file of its own"
        with users_code(f"effect {name!r}", advice):
            return _checked(name, pkgutil.resolve_name(name))
    known = ", ".join(sorted([*BUILT_IN, *plugins]))
    raise BadInputError(f"effect {name!r} is unknown; allowed: {known}, or module:Class for one of your own")


def reference_of(effect: type[Effect]) -> str:
    """Name by which :func:`effect_class` finds a class: its own if built in or a plug-in, else ``module:Class``."""
    if BUILT_IN.get(effect.name) is effect:
        return effect.name
    path = f"{effect.__module__}:{effect.__qualname__}"
    plugins = {entry.name for entry in entry_points(group=ENTRY_POINT_GROUP) if entry.value == path}
    return effect.name if effect.name in plugins else path


def make_effect(name: str, fields: dict[str, Any]) -> Effect:
    """Build the effect ``name`` from its parameters and joints.

    Raises:
        BadInputError: A key is not a parameter of the effect, or a value is out of bounds or no number.
    """
    cls = effect_class(name)
    allowed = [p.name for p in cls.parameters()]
    values: dict[str, Any] = {}
    for key, value in fields.items():
        if key == "joints":
            values[key] = _joint_names(name, value)
        elif key not in allowed:
            raise BadInputError(f"effect {name}: unknown key {key!r}; allowed: {', '.join(['joints', *allowed])}")
        elif isinstance(value, bool) or not isinstance(value, (int, float)):
            raise BadInputError(f"effect {name}: {key} = {value!r} is no number; allowed: a number")
        else:
            values[key] = float(value)
    return cls(**values)


def _joint_names(effect: str, value: Any) -> tuple[str, ...]:
    if isinstance(value, str):
        return (value,)
    if isinstance(value, (list, tuple)) and all(isinstance(v, str) for v in value):
        return tuple(value)
    raise BadInputError(f"effect {effect}: joints = {value!r}; allowed: a name or a list of names")


def _checked(name: str, found: Any) -> type[Effect]:
    if not (isinstance(found, type) and issubclass(found, Effect)):
        raise BadInputError(f"effect {name!r} is {found!r}; allowed: a subclass of spot_model.effects.base.Effect")
    return found
