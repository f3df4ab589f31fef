"""Kinds that judge, by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from withheld.realities.fault_kind import FaultKind
from withheld.realities.judging import body, drive, friction, limits, outside, sensing, transport

CATALOGUE: Final[Mapping[str, FaultKind]] = {
    kind.name: kind for module in (friction, drive, limits, transport, sensing, body, outside) for kind in module.KINDS
}
