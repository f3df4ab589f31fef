"""Find a reward term by its key in the config: built in, installed, or ``module:function``."""

from __future__ import annotations

import pkgutil
from importlib.metadata import entry_points
from typing import Any

from spot_model.errors import BadInputError
from spot_model.user_code import users_code
from trainer.config.reward_config import ENTRY_POINT_GROUP
from trainer.task.rewards import TERMS, Term


def reward_term(name: str) -> Term:
    """The function called ``name``: it takes a :class:`~trainer.task.rewards.Moment` and the config's shape numbers.

    Raises:
        BadInputError: There is none, or what is there cannot be called.
    """
    if name in TERMS:
        return TERMS[name]
    installed = {entry.name: entry for entry in entry_points(group=ENTRY_POINT_GROUP)}
    with users_code(f"reward {name!r}", "check module and function name"):
        if name in installed:
            return _checked(name, installed[name].load())
        if ":" in name:
            return _checked(name, pkgutil.resolve_name(name))
    known = ", ".join(sorted([*TERMS, *installed]))
    raise BadInputError(f"reward {name!r} is unknown; allowed: {known}, or module:function for one of your own")


def _checked(name: str, found: Any) -> Term:
    if not callable(found):
        raise BadInputError(f"reward {name!r} is {found!r}; allowed: a function of a moment and the shape numbers")
    term: Term = found
    return term
