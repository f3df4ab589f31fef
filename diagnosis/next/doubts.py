"""What is in doubt after a diagnosis, and what logs tell of it.

What logs tell of each number beside the ordinary errors, and beside the effects that could be there in its place, is
linear and Gaussian; formulas leave a part of each interval, whatever is recorded.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from diagnosis.decision_constants import PARAMETER_SPREAD
from diagnosis.document import CalibratedNumber, Number, Verdict
from diagnosis.library import LibraryEffect
from diagnosis.report import words
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.scoring import Placed, Scorer, ranges
from diagnosis.verdict.calibration import NEVER_MET, Z_90, calibrated_numbers
from diagnosis.verdict.posterior_file import Posterior
from spot_model.io.model_file import RobotModel
from spot_model.robot.joints import select_joints

WORTH: Final = 0.2
"""Least share by which a recording has to narrow one number's interval. Half as many strides more would narrow it by
1 − 1/√1.5 = 0.18 whatever they are: a recording that is worth it tells more than that."""
SURE: Final = 0.9
"""What is so probable, or so improbable, is in no doubt."""
Key = tuple[str, str, str]
"""Effect, parameter and place of a number; of a difference no place."""


class Doubt(NamedTuple):
    """A number with the half-width of its 90 % interval."""

    key: Key
    title: str
    unit: str
    now: float
    """Half-width."""
    left: float
    """The part of it that formulas leave, whatever is recorded."""

    def told(self, half: float) -> str:
        """A half-width in words."""
        return f"± {words.number(half, '' if self.unit == '1' else self.unit)}"

    def after(self, ratio: float) -> float:
        """The half-width where what logs tell scatters by so many times what it did."""
        return float(np.hypot(self.left, np.sqrt(max(self.now**2 - self.left**2, 0.0)) * ratio))


def doubts_of(verdict: Verdict, library: Mapping[str, LibraryEffect]) -> tuple[Doubt, ...]:
    """Numbers that a recording could narrow: of differences, and the robot's own that may stand out."""
    found, named = [], {d.name for d in verdict.differences}
    for d in verdict.differences:
        null = {p.name: p.null for p in library[d.name].effect.parameters()}
        for name, p in d.parameters.items():
            zero = null[name] if abs(null.get(name, np.inf)) < NEVER_MET else 0.0
            title = f"{words.found(d)}: {words.parameter(name)}"
            found.append(Doubt((d.name, name, ""), title, p.unit, _half(p), _left(p.value - zero)))
    for n in verdict.calibration.numbers:
        if n.effect not in named and 1.0 - SURE < n.probability < SURE:
            title = f"{n.title}, {words.place(n.where)}"
            found.append(Doubt(_key(n), title, n.unit, _half(n), _left(n.value - n.nominal)))
    return tuple(d for d in found if d.after(0.0) < (1.0 - WORTH) * d.now)


def known(
    board: Evidence, verdict: Verdict, posterior: Posterior, nominal: RobotModel, library: Mapping[str, LibraryEffect]
) -> dict[Key, float]:
    """By how much what logs tell of each number scatters; ``board`` is theirs, all else is of the diagnosis."""
    terms: dict[tuple[str, tuple[str, ...]], Placed] = {}
    for p in sorted(posterior.possibilities, key=lambda p: -p.weight):
        for t in p.terms:
            units = board.robot.units(library[t.effect].location)
            place = (units @ select_joints(t.joints) > 0.5).astype(np.float64)
            terms.setdefault((t.effect, t.joints), Placed(library[t.effect], t.shape, place))
    stated = [t for (effect, _), t in terms.items() if effect in {d.name for d in verdict.differences}]
    found = {
        _key(n): float(np.sqrt(max(_half(n) ** 2 - _left(n.value - n.nominal) ** 2, 0.0)))
        for n in calibrated_numbers(board, Scorer(board, stated).now, nominal)
    }
    if not terms:
        return found
    scorer, some = Scorer(board, list(terms.values())), next(iter(terms.values()))
    held = ranges([t.effect for t in scorer.terms]) ** -2
    # Whatever the bounds: a number that is fitted at one of them is not known.
    information = scorer.information(some.effect, some.shape, scorer.weights)[0][: len(held), : len(held)]
    scatter, first = np.sqrt(np.diag(np.linalg.pinv(information + np.diag(held), hermitian=True))), 0
    # The first term of an effect is its strongest. A number in its shape goes with the effect as a whole.
    for effect, _ in terms:
        names = [c.name for c in library[effect].coefficients]
        for own in library[effect].effect.parameters():
            at = first + (names.index(own.name) if own.name in names else 0)
            found.setdefault((effect, own.name, ""), float(scatter[at]))
        first += len(names)
    return found


def _half(n: Number | CalibratedNumber) -> float:
    # Bounds cut one side at most.
    return max(n.high - n.value, n.value - n.low)


def _left(size: float) -> float:
    return Z_90 * PARAMETER_SPREAD * abs(size)


def _key(n: CalibratedNumber) -> Key:
    return n.effect, n.parameter, n.where
