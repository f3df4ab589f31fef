"""What is in doubt after a diagnosis, and how much of it a recording leaves: its columns beside those of the logs.

A simulated run of the recording is laid out beside the logs as a diagnosis does it. What all of it tells of each number
beside the ordinary errors is linear and Gaussian; formulas leave a part of each interval, whatever is recorded.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from diagnosis.decision_constants import FORMULA_ERROR, PARAMETER_SPREAD
from diagnosis.document import CalibratedNumber, Number, Verdict
from diagnosis.library import LibraryEffect
from diagnosis.report import words
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.scoring import Placed, Scorer, spreads
from diagnosis.verdict.calibration import NEVER_MET, Z_90, calibrated_numbers
from diagnosis.verdict.posterior_file import Posterior, Term
from spot_model.io.model_file import RobotModel
from spot_model.robot.joints import select_joints

WORTH: Final = 0.2
"""Least share by which a recording has to narrow one number's interval. Half as many strides more would narrow it by
1 − 1/√1.5 = 0.18 whatever they are: a recording that is worth it tells more than that."""
SURE: Final = 0.9
"""What is so probable, or so improbable, is in no doubt."""
Key = tuple[str, str, str]
"""Effect, parameter and place of a number; of the question which effect it is, the effect alone."""


class Doubt(NamedTuple):
    """A number with the half-width of its 90 % interval, or the question which effect it is."""

    key: Key
    title: str
    now: float
    """Half-width; of the question, the probability that it is another effect."""
    unit: str = ""
    left: float = 0.0
    """The part of the half-width that formulas leave, whatever is recorded."""

    def told(self, size: float) -> str:
        """A half-width or a probability in words."""
        return f"± {words.number(size, self.unit)}" if self.key[1] else words.percent(size)

    def after(self, before: float, then: float) -> float:
        """What is expected of it where :func:`known` tells ``before`` of the logs and ``then`` of all."""
        if not self.key[1]:
            return then
        return float(np.hypot(self.left, np.sqrt(max(self.now**2 - self.left**2, 0.0)) * then / before))

    @property
    def is_open(self) -> bool:
        """Whether a recording that leaves nothing but what formulas leave would be worth it."""
        return self.left < (1.0 - WORTH) * self.now


def doubts_of(verdict: Verdict, library: Mapping[str, LibraryEffect]) -> tuple[Doubt, ...]:
    """What a recording could narrow: differences, their rivals, and numbers of the robot's own that may stand out."""
    found, named = [], {d.name for d in verdict.differences}
    for d in verdict.differences:
        where = f" at {words.joints_in_short(d.joints)}" if d.joints else ""
        null = {p.name: p.null for p in library[d.name].effect.parameters()}
        if len(d.group) > 1:
            another = 1.0 - d.rivals[d.name] / sum(d.rivals.values())
            found.append(Doubt((d.name, "", ""), f"another effect than {d.title}{where}", another))
        for name, p in d.parameters.items():
            zero = null[name] if abs(null.get(name, np.inf)) < NEVER_MET else 0.0
            title = f"{d.title}{where}: {words.parameter(name)}"
            found.append(Doubt((d.name, name, ""), title, _half(p), p.unit, _left(p.value - zero)))
    for n in verdict.calibration.numbers:
        if n.effect not in named and 1.0 - SURE < n.probability < SURE:
            title = f"{n.title}, {words.place(n.where)}"
            found.append(Doubt(_key(n), title, _half(n), n.unit, _left(n.value - n.nominal)))
    return tuple(doubt for doubt in found if doubt.is_open)


def _half(n: Number | CalibratedNumber) -> float:
    # Bounds cut one side at most.
    return max(n.high - n.value, n.value - n.low)


def _left(size: float) -> float:
    return Z_90 * PARAMETER_SPREAD * abs(size)


def _key(n: CalibratedNumber) -> Key:
    return n.effect, n.parameter, n.where


def known(
    board: Evidence, verdict: Verdict, posterior: Posterior, nominal: RobotModel, library: Mapping[str, LibraryEffect]
) -> dict[Key, float]:
    """What logs tell of all numbers, in multiples of a standard deviation, and of each group that it is another effect.

    ``board`` is of the logs, with or without a simulated run beside; all else is of the diagnosis.
    """

    def placed(t: Term) -> Placed:
        units = board.robot.units(library[t.effect].location)
        return Placed(library[t.effect], t.shape, (units @ select_joints(t.joints) > 0.5).astype(np.float64))

    sets = {frozenset(t.effect for t in p.terms): [placed(t) for t in p.terms] for p in posterior.possibilities}
    stated = frozenset(d.name for d in verdict.differences)
    terms = sets.get(stated, [])
    scorer = Scorer(board, terms)
    found = {
        _key(n): float(np.sqrt(max(_half(n) ** 2 - _left(n.value - n.nominal) ** 2, 0.0)))
        for n in calibrated_numbers(board, scorer.now, nominal)
    }
    names = [(t.effect.name, c.name) for t in terms for c in t.effect.coefficients]
    by_name = dict(zip(reversed(names), reversed(spreads(scorer)), strict=True))
    for d in verdict.differences if terms else ():
        mine = next(t for t in terms if t.effect.name == d.name)
        size = by_name[d.name, mine.effect.coefficients[0].name]
        found |= {(d.name, name, ""): float(by_name.get((d.name, name), size)) for name in d.parameters}
        beside = Scorer(board, [t for t in terms if t is not mine])
        # As a verdict weighs rivals. What is recorded may move their shapes.
        own, odds = _best(beside, mine), 0.0
        for rival in (sets.get(stated - {d.name} | {name}) for name in d.group if name != d.name):
            if rival:
                less = own - _best(Scorer(board, rival[:-1]), rival[-1])
                odds += float(np.exp(-max(less, 0.0) / (1.0 + FORMULA_ERROR * max(own - beside.now.value, 0.0))))
        found[d.name, "", ""] = odds / (1.0 + odds)
    return found


def _best(beside: Scorer, own: Placed) -> float:
    """Value of an effect in the best of the shapes near its own."""
    shapes = (own.shape, *own.effect.refined(own.shape))
    return max(beside.scored(own.effect, shape, own.place).value for shape in shapes)
