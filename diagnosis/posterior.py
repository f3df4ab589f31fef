"""Probabilities: of each effect or group, of none and of unknown, by a calibration that lies beside this file."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from diagnosis.seam import Array
from diagnosis.selection.search import Rival, Selection
from diagnosis.unknown import Remainder
from diagnosis.verdict import Shrink

FILE: Final = Path(__file__).with_name("calibration.json")
MAX_GROUP: Final = 3
CLOSED_BY_CHANCE: Final = 0.4
"""S of a model without the cause, where its interval excludes none: at most 0.44 in 44 withheld cases of such."""
LEAST_LEFT: Final = 0.1
"""Nobody knows S so well that less of the odds would be left."""
PLAIN_GAP: Final = 2.5
"""Closed loops so many floors from the robot's are a plain gap: with nothing amiss they are up to 2.3."""
UNMOVED: Final = 0.2
"""S up to which the found effects leave such a gap as it was."""
UNMOVED_HIGH: Final = 0.75
"""And the upper end of its interval, beyond which they may close it nevertheless."""
MIMIC_NATS: Final = 120.0
"""Effects that bring more are there, whatever closed loops say: a soft gear is seen, and hardly acts in its model.

Of verdicts on plain gaps that stayed as they were, in 473 withheld cases, all 13 that brought less were wrong, and 6 of
7 that brought more named a true effect.
"""
UNMOVED_ODDS: Final = 4.0
"""Odds that the cause is unknown where effects that bring less leave a plain gap as it was."""


@dataclass(frozen=True)
class Calibration:
    """Numbers that turn scores into decisions and probabilities."""

    threshold_nats: float
    """What an effect must add."""
    none_power: float
    """P(none) is 1/(1 + (gain/threshold)^power)."""
    temperature_min_nats: float
    temperature_share: float
    """Rivals' odds are exp(−difference/temperature); the temperature grows with the gain, since models err."""
    group_odds: float
    """A rival with at least these odds against the best is in its group."""
    unknown_nats: float
    unknown_share: float
    """What is usually left and predictable: so many nats, and a share of what the found effects bring."""
    unknown_width: float
    """P(unknown) is a logistic function of the logarithm of what is left over that."""
    usual_left: Mapping[str, float]
    """By channel, predictable nats that are left with nothing amiss, and do not count."""
    tolerance: Mapping[str, float]
    """By channel, units of its noise."""
    dof: float
    """Independent ways in which a formula can be off, in each signal."""
    relative: float
    """Share of what a formula explains by which it is usually off."""
    ordinary: Mapping[str, Mapping[str, Any]]
    """Usual sizes of the errors of a nominal model; :mod:`diagnosis.selection.ordinary`."""

    @staticmethod
    def load(path: Path = FILE) -> Calibration:
        """Read it."""
        data = json.loads(path.read_text(encoding="utf-8"))
        data.pop("made_by", None)
        return Calibration(**data)


@dataclass(frozen=True)
class Group:
    """A chosen effect with its rivals."""

    names: tuple[str, ...]
    """Members, best first."""
    probabilities: Mapping[str, float]
    """Of every rival in this place, given that one of the library is there; adds up to 1."""
    margin_nats: float


@dataclass(frozen=True)
class Posterior:
    """Probabilities."""

    none: float
    unknown: float
    groups: tuple[Group, ...]


def posterior(selection: Selection, left: Remainder | None, calibration: Calibration) -> Posterior:
    """Turn scores into probabilities.

    Args:
        selection: What was chosen.
        left: What no effect explains; None without channel A.
        calibration: Numbers.
    """
    unknown = _unknown(left, calibration)
    first = selection.first[0] if selection.first else None
    top = first.value if first is not None else 0.0
    gain = sum(selection.gains) if selection.gains else max(top, 0.0)
    ratio = max(gain, 1e-9) / calibration.threshold_nats
    none = 1.0 / (1.0 + ratio**calibration.none_power)
    none *= 1.0 - unknown
    return Posterior(
        none=none,
        unknown=unknown * (1.0 - none),
        groups=tuple(group(r, g, calibration) for r, g in zip(selection.rivals, selection.gains, strict=True)),
    )


def after_shrink(found: Posterior, shrink: Shrink, gain_nats: float) -> Posterior:
    """The probabilities, knowing how much of the gap the found effects close in closed loops that no fit saw.

    Residuals say that something is left; closed loops say how much it can matter. Models that lack the cause close
    two fifths of the gap, so from there on the odds of an unknown effect fall with what is left of it. A plain gap
    that stays as it was has another cause. An S that may be anything says nothing.

    Args:
        found: From the residuals alone.
        shrink: Held-out.
        gain_nats: What the found effects bring, all together.
    """
    if shrink.s is None or shrink.s_low is None or shrink.s_high is None or found.unknown >= 1.0:
        return found
    odds = found.unknown / (1.0 - found.unknown)
    if shrink.s_low > 0.0 and shrink.s > CLOSED_BY_CHANCE:
        # What the unknown loses goes to the effects: none is ruled out by the same shrink.
        odds *= max((1.0 - shrink.s) / (1.0 - CLOSED_BY_CHANCE), LEAST_LEFT)
    elif (
        shrink.d0 > PLAIN_GAP * shrink.floor > 0.0
        and shrink.s <= UNMOVED
        and shrink.s_high < UNMOVED_HIGH
        and gain_nats < MIMIC_NATS
    ):
        odds = max(odds, UNMOVED_ODDS)
    else:
        return found
    unknown = odds / (1.0 + odds)
    return replace(found, unknown=unknown, none=min(found.none, 1.0 - unknown))


def group(rivals: Sequence[Rival], gain: float, calibration: Calibration) -> Group:
    """Rivals' probabilities, and who is too near to the best to be ruled out."""
    temperature = max(calibration.temperature_min_nats, calibration.temperature_share * max(gain, 0.0))
    values: Array = np.array([r.value for r in rivals])
    weights = np.exp((values - values.max()) / temperature)
    weights = weights / weights.sum()
    names = [r.scored.terms[-1].effect.name for r in rivals]
    near = [n for n, w in zip(names, weights, strict=True) if w >= calibration.group_odds * weights.max()]
    return Group(
        names=tuple(near[:MAX_GROUP]),
        probabilities={n: float(w) for n, w in zip(names, weights, strict=True) if w > 1e-3},
        margin_nats=float(-temperature * np.log(calibration.group_odds)),
    )


def _unknown(left: Remainder | None, calibration: Calibration) -> float:
    """A logistic function of the logarithm of what is left over a sum of what is usual and a share of what is found."""
    if left is None:
        return 0.02
    usual = calibration.unknown_nats + calibration.unknown_share * max(left.explained_nats, 0.0)
    odds = np.log(max(left.beyond(calibration.usual_left), 1e-3) / usual) / calibration.unknown_width
    return float(np.clip(1.0 / (1.0 + np.exp(-odds)), 0.02, 0.98))
