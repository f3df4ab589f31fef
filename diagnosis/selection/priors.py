"""How large an effect's numbers can realistically be: the wide part of each number's prior."""

from __future__ import annotations

from typing import Final

import numpy as np

from diagnosis.channels import Array
from diagnosis.decision_constants import ERROR_SCALES, ErrorScale
from diagnosis.library import LibraryEffect

LARGEST_IN_SPREADS: Final = 10.0
"""Largest realistic size in published spreads, where an entry names none: half the torque lost, 2 N·m of friction or
of a zero, 5 kg, 3 degrees of an encoder."""


def realistic_range(effect: LibraryEffect) -> Array:
    """Largest realistic size of each coefficient, within its bounds; infinite without freedom. Shape (C,)."""
    given = ERROR_SCALES.get(effect.name, ErrorScale({}))
    times = LARGEST_IN_SPREADS * max(1.0, given.alike)
    asked = [effect.largest.get(c.name, times * given.scales.get(c.name, np.inf)) for c in effect.coefficients]
    within = np.minimum([max(abs(c.low), abs(c.high)) for c in effect.coefficients], asked)
    return np.where([c.is_free for c in effect.coefficients], within, np.inf)
