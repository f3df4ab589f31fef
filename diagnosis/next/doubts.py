"""What is in doubt after a diagnosis, and how much of it a recording leaves: its columns beside those of the logs.

A simulated run of the recording is laid out beside the logs as a diagnosis does it, with the ordinary errors. The same
formulas then state the intervals: what is expected is what a diagnosis of all logs would say of such a robot.
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
from diagnosis.selection.scoring import Placed, Scorer
from diagnosis.verdict.calibration import NEVER_MET, Z_90, calibrated_numbers, numbers
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
    unit: str

    def told(self, size: float) -> str:
        """A half-width or a probability in words."""
        return f"± {words.number(size, self.unit)}" if self.key[1] else words.percent(size)


def doubts_of(verdict: Verdict, library: Mapping[str, LibraryEffect]) -> tuple[Doubt, ...]:
    """What a recording could narrow: differences, their rivals, and numbers of the robot's own that may stand out.

    Formulas leave a part of each interval, whatever is recorded: where that is nearly all, the number is settled.
    """
    found, named = [], {d.name for d in verdict.differences}
    for d in verdict.differences:
        where = f" at {words.joints_in_short(d.joints)}" if d.joints else ""
        null = {p.name: p.null for p in library[d.name].effect.parameters()}
        if len(d.group) > 1:
            another = 1.0 - d.rivals[d.name] / sum(d.rivals.values())
            found.append(Doubt((d.name, "", ""), f"another effect than {d.title}{where}", another, ""))
        for name, p in d.parameters.items():
            zero = null[name] if abs(null.get(name, np.inf)) < NEVER_MET else 0.0
            if not _is_settled(p, p.value - zero):
                found.append(Doubt((d.name, name, ""), f"{d.title}{where}: {words.parameter(name)}", _half(p), p.unit))
    for n in verdict.calibration.numbers:
        is_open = n.effect not in named and 1.0 - SURE < n.probability < SURE
        if is_open and not _is_settled(n, n.value - n.nominal):
            found.append(Doubt(_key(n), f"{n.title}, {words.place(n.where)}", _half(n), n.unit))
    return tuple(found)


def _half(n: Number | CalibratedNumber) -> float:
    return 0.5 * (n.high - n.low)


def _key(n: CalibratedNumber) -> Key:
    return n.effect, n.parameter, n.where


def _is_settled(n: Number | CalibratedNumber, size: float) -> bool:
    return Z_90 * PARAMETER_SPREAD * abs(size) >= (1.0 - WORTH) * _half(n)


def left_in_doubt(
    board: Evidence, verdict: Verdict, posterior: Posterior, nominal: RobotModel, library: Mapping[str, LibraryEffect]
) -> dict[Key, float]:
    """Half-widths of all numbers, and of each group the probability that it is another effect; by key.

    ``board`` is of the logs and the simulated run; all else is of the diagnosis.
    """

    def placed(t: Term) -> Placed:
        units = board.robot.units(library[t.effect].location)
        return Placed(library[t.effect], t.shape, (units @ select_joints(t.joints) > 0.5).astype(np.float64))

    sets = {frozenset(t.effect for t in p.terms): [placed(t) for t in p.terms] for p in posterior.possibilities}
    stated = frozenset(d.name for d in verdict.differences)
    terms = sets.get(stated, [])
    found = {_key(n): _half(n) for n in calibrated_numbers(board, Scorer(board, terms).now, nominal)}
    for d in verdict.differences if terms else ():
        mine = next(t for t in terms if t.effect.name == d.name)
        beside = Scorer(board, [t for t in terms if t is not mine])
        fit = beside.scored(mine.effect, mine.shape, mine.place)
        found |= {(d.name, name, ""): _half(p) for name, p in numbers(beside, fit).items()}
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
