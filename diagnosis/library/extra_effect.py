"""Which effects are tried: the library, ``--without`` some, with ``--add-effect module:Class`` of the user's own."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import EntryPoint

from diagnosis.library.base import LibraryEffect
from diagnosis.library.plain_effect import entry_of
from diagnosis.library.registry import LIBRARY
from spot_model.effects.base import Effect
from spot_model.errors import BadInputError
from spot_model.user_code import users_code


def chosen_library(added: Sequence[str | type], left_out: Sequence[str]) -> dict[str, LibraryEffect]:
    """The library with effects added and left out.

    Args:
        added: Each as ``module:Class``, or the class itself.
        left_out: Names of the library.

    Raises:
        BadInputError: A name is unknown, or a class cannot be loaded.
    """
    library = dict(LIBRARY)
    for name in left_out:
        if name not in LIBRARY:
            raise BadInputError(f"--without {name!r} is not in the library; allowed: {', '.join(LIBRARY)}")
        library.pop(name, None)
    for value in added:
        effect = _load(value)
        if effect.name in library:
            raise BadInputError(
                f"--add-effect {value!r} is named {effect.name!r}, as one of the library is; rename it, or leave the "
                f"library's out with --without {effect.name}"
            )
        library[effect.name] = effect
    if not library:
        raise BadInputError("the library is empty; leave at least one effect in it")
    return library


def _load(value: str | type) -> LibraryEffect:
    with users_code(f"--add-effect {value!r}", "is it on the Python path, and whole?"):
        return _entry(value, value if isinstance(value, type) else _found(value))


def _entry(value: str | type, made: object) -> LibraryEffect:
    if isinstance(made, type) and issubclass(made, Effect):
        return entry_of(made)
    if not (isinstance(made, type) and issubclass(made, LibraryEffect)):
        raise BadInputError(f"--add-effect {value!r} is no Effect of spot_model.effects.base, and no LibraryEffect")
    for needed in ("effect", "coefficients"):
        if not hasattr(made, needed):
            raise BadInputError(f"--add-effect {value!r} lacks the attribute {needed}; write it")
    try:
        effect: LibraryEffect = made()
    except TypeError as error:
        raise BadInputError(f"--add-effect {value!r} cannot be made: {error}; write what is missing") from error
    return effect


def _found(value: object) -> object:
    if not isinstance(value, str) or value.count(":") != 1:
        raise BadInputError(f"--add-effect {value!r}; allowed: module:Class, a subclass of Effect or LibraryEffect")
    return EntryPoint(name="effect", value=value, group="spot_rl.library").load()
