"""Where realities come from: one of the two catalogues, or ``module:Class`` of a user."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final

from spot_model.errors import BadInputError
from spot_model.user_code import users_code
from withheld.plan import FaultRequest, Reality
from withheld.realities.calibrating import body as c_body
from withheld.realities.calibrating import drive as c_drive
from withheld.realities.calibrating import limits as c_limits
from withheld.realities.calibrating import outside as c_outside
from withheld.realities.calibrating import signals as c_signals
from withheld.realities.fault_kind import FaultKind
from withheld.realities.judging import body, drive, limits, outside, signals

_KINDS: Final[Mapping[str, Sequence[FaultKind]]] = {
    "judging": (*drive.KINDS, *limits.KINDS, *signals.KINDS, *body.KINDS, *outside.KINDS),
    "calibrating": (*c_drive.KINDS, *c_limits.KINDS, *c_signals.KINDS, *c_body.KINDS, *c_outside.KINDS),
}
CATALOGUES: Final[Mapping[str, Mapping[str, FaultKind]]] = {
    name: {kind.name: kind for kind in kinds} for name, kinds in _KINDS.items()
}
"""Kinds by name; what a case draws follows from their order."""

ENTRY_POINT_GROUP: Final = "spot_rl.realities"


@dataclass(frozen=True)
class Source:
    """Makes realities."""

    name: str
    """A catalogue's name, or ``module:Class``."""
    kinds: Mapping[str, FaultKind]
    """What a case may ask for; empty: the reality chooses by itself."""

    def make(self, requests: Sequence[FaultRequest], seed: int) -> Reality:
        """A reality with these faults. The same seed without some of them is the same robot without them."""
        if self.name in CATALOGUES:
            from withheld.realities.reality import make

            own: Reality = make(requests, seed, CATALOGUES[self.name])
            return own
        loaded = _load(self.name)
        made: Reality = loaded(seed, tuple(requests)) if self.kinds else loaded(seed)
        return made


def source_of(name: str) -> Source:
    """The source of that name.

    ``judging`` and ``calibrating`` are the package's own catalogues. A user's class has a constructor ``(seed: int)``
    and the methods of :class:`withheld.plan.Reality`. With an attribute ``KINDS``, like a catalogue's, and a
    constructor ``(seed, requests)`` its cases are drawn as the package's own.

    Raises:
        BadInputError: It cannot be loaded.
    """
    if name in CATALOGUES:
        return Source(name, CATALOGUES[name])
    kinds: Mapping[str, FaultKind] = getattr(_load(name), "KINDS", {})
    return Source(name, kinds)


def _load(name: str) -> Any:
    plugins = {entry.name: entry for entry in entry_points(group=ENTRY_POINT_GROUP)}
    if name.count(":") != 1 and name not in plugins:
        raise BadInputError(
            f"--reality {name!r}; allowed: {', '.join([*CATALOGUES, *plugins])}, or module:Class with the methods of "
            "withheld.plan.Reality"
        )
    with users_code(f"--reality {name!r}", "is it on the Python path?"):
        made = plugins.get(name, EntryPoint(name, name, ENTRY_POINT_GROUP)).load()
    missing = [m for m in ("record", "truth", "nominal") if not hasattr(made, m)]
    if missing:
        raise BadInputError(f"--reality {name!r} lacks {', '.join(missing)}; see withheld.plan.Reality")
    return made
