"""The robot's own numbers beside the nominal ones: what the logs say of each, whatever else they show.

A number is the mean over its place (a joint type, a leg, the body; zeros are set joint by joint) of all that was fitted
to it: the ordinary errors that units have by themselves, by type and together, and differences of the same effect. Its
interval is that of the sum, since logs often tell the sum of columns that they do not tell apart. Joints that a
difference singles out, at most half of their type, are left out of the type's mean: they are the difference's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import expit

from diagnosis.channels import Array, Flags, Shape
from diagnosis.decision_constants import ERROR_SCALES, LARGEST_IN_SPREADS, NAMED, ODD, PARAMETER_SPREAD, TAUGHT
from diagnosis.document import CalibratedNumber, Number
from diagnosis.library import JointGroups, LibraryEffect, Location, lacks_loads
from diagnosis.selection.evidence import Evidence, key_of
from diagnosis.selection.ordinary_errors import ErrorKind
from diagnosis.selection.robot_models import within
from diagnosis.selection.scoring import Scored, Scorer, posterior_covariance
from spot_model.effects.base import Effect, Parameter
from spot_model.effects.bodies import ComOffset, PayloadMass
from spot_model.io.model_file import RobotModel
from spot_model.robot import facts
from spot_model.text import parameter_words

ZEROS: Final = frozenset({"offset_rad", "bias_nm"})
"""Set joint by joint: their mean over a type is nobody's number."""
NOT_OF_THE_ROBOT: Final = frozenset({"ground_friction", "ground_compliance", "ground_slope"})
Z_90: Final = 1.645
PROFILE_NATS: Final = 1.35
"""A shape whose value is within this of the best is within its 90 % interval."""
MOST_SHAPES: Final = 60
"""No further shapes are tried for an interval after so many."""
NEVER_MET: Final = 1e5
"""Null values from here on stand for a limit that is never met."""


@dataclass(frozen=True)
class _Fit:
    """All that was fitted, with its covariance; a number is a row of weights on it."""

    board: Evidence
    scored: Scored
    values: Array
    """Ordinary errors, then coefficients, shape (Q + K,)."""
    covariance: Array
    """Shape (Q + K, Q + K)."""

    @staticmethod
    def of(board: Evidence, scored: Scored) -> _Fit:
        values = np.concatenate([scored.pulls, *scored.coefficients])
        return _Fit(board, scored, values, posterior_covariance(board, scored))

    def weights(self, effect: str, coefficient: str, units: Flags, at: str = "") -> tuple[Array, Array]:
        """How far one unit of each fitted value moves the mean of a coefficient over some units.

        Args:
            effect: Name of the effect.
            coefficient: Name of its coefficient.
            units: Shape (U,).
            at: Parameter of the shape that the coefficient is a multiple of; empty where it is the number itself.

        Returns:
            Weights, shape (Q + K,); and what one published standard deviation moves it by through each of the ordinary
            errors, shape (Q,).
        """
        out, published = np.zeros(len(self.values)), np.zeros(len(self.scored.pulls))
        ordinary, n = self.board.ordinary, units.sum()
        for kind in ordinary.kinds:
            names = [kind.effect.coefficients[c].name for c in kind.chosen]
            if kind.effect.name == effect and coefficient in names:
                columns = kind.columns(names.index(coefficient))
                share = np.array([(s & units).sum() / n for s in kind.sets]) * (kind.at[at] if at else 1.0)
                out[: len(published)][columns] = share * ordinary.scale[columns]
                published[columns] = share * ordinary.scale[columns]
        first = len(published)
        for term, own in zip(self.scored.terms, self.scored.coefficients, strict=True):
            names = [c.name for c in term.effect.coefficients]
            if term.effect.name == effect and coefficient in names:
                share_of = float((term.place * units).sum() / n) * (term.shape[at] if at else 1.0)
                out[first + names.index(coefficient)] = share_of
            first += len(own)
        return out, published

    def found(self, weights: Array) -> tuple[float, float]:
        """Value and standard deviation."""
        variance = float(weights @ self.covariance @ weights)
        return float(weights @ self.values), math.sqrt(max(variance, 0.0))


def calibrated_numbers(board: Evidence, scored: Scored, nominal: RobotModel) -> tuple[CalibratedNumber, ...]:
    """The robot's own numbers, farthest from the nominal model first, in published standard deviations.

    Those of which the logs say less than the publications do are left out.

    Args:
        board: Has the ordinary errors.
        scored: Differences, maybe none, with the ordinary errors that were fitted beside them.
        nominal: The model that they are fitted to.
    """
    fit = _Fit.of(board, scored)
    found = []
    for kind in board.ordinary.kinds:
        if kind.effect.name not in NOT_OF_THE_ROBOT:
            found += list(_numbers(fit, kind, _places, nominal))
        if kind.effect.name == PayloadMass.name:
            found += list(_centre_of_mass(fit, kind, nominal))
    return tuple(sorted(found, key=lambda n: -abs(n.value - n.nominal) / n.spread))


def unit_numbers(board: Evidence, scored: Scored, nominal: RobotModel) -> tuple[CalibratedNumber, ...]:
    """Numbers of each joint and leg by itself, and of the floor, with the differences there; see the numbers above."""
    fit = _Fit.of(board, scored)
    return tuple(n for kind in board.ordinary.kinds for n in _numbers(fit, kind, _units, nominal))


def by_type(scorer: Scorer, scored: Scored) -> dict[str, dict[str, Number]]:
    """Numbers of the last term by joint type, with what ordinary errors add to them there.

    Args:
        scorer: Has the other terms.
        scored: They and the term.

    Returns:
        By joint type and parameter; empty where all intervals overlap, or the effect has no ordinary errors: one number
        serves, then.
    """
    term, board = scored.terms[-1], scorer.board
    kind = next((k for k in board.ordinary.kinds if k.effect.name == term.effect.name), None)
    if term.effect.location is not Location.JOINT or kind is None:
        return {}
    fit = _Fit.of(board, scored)
    out: dict[str, dict[str, Number]] = {}
    for where, joints in board.robot.types().items():
        units = joints & (term.place > 0.5)
        for c in kind.chosen if units.any() else ():
            named = _parameter(kind, int(c))
            if named is not None:
                known, at = named
                weights, _ = fit.weights(term.effect.name, term.effect.coefficients[c].name, units, at)
                value, low, high = _interval(*fit.found(weights), known, known.null)
                out.setdefault(where, {})[known.name] = Number(value=value, low=low, high=high, unit=_unit(known))
    numbers = [[own[name] for own in out.values()] for name in next(iter(out.values()), {})]
    is_apart = any(max(n.low for n in same) > min(n.high for n in same) for same in numbers)
    return out if is_apart else {}


Places = Callable[[JointGroups, LibraryEffect, str], list[tuple[str, Flags]]]
"""Names and units of the places that have a number of their own, from robot, effect and coefficient."""


def _numbers(fit: _Fit, kind: ErrorKind, places: Places, nominal: RobotModel) -> Iterator[CalibratedNumber]:
    for c in map(int, kind.chosen):
        named = _parameter(kind, c)
        if named is not None:
            yield from _of_coefficient(fit, kind, c, *named, places, nominal)


def _of_coefficient(
    fit: _Fit, kind: ErrorKind, c: int, known: Parameter, at: str, places: Places, nominal: RobotModel
) -> Iterator[CalibratedNumber]:
    effect, coefficient = kind.effect, kind.effect.coefficients[c].name
    robot, given = fit.board.robot, ERROR_SCALES[effect.name]
    for where, units in places(robot, effect, coefficient):
        left = units & ~_singled_out(fit.scored, effect, units)
        if not left.any():
            continue
        weights, published = fit.weights(effect.name, coefficient, left, at)
        value, deviation = fit.found(weights)
        is_different = bool(np.any(weights[len(published) :]))
        if not is_different and deviation**2 > TAUGHT * float(published @ published):
            continue
        # What all of a robot share scatters between robots by more than its units do, where it is published so.
        spread = given.scales[coefficient] * max(1.0, given.alike) * (kind.at[at] if at else 1.0)
        before = in_model(nominal, robot, effect.effect, known, left @ robot.units(effect.location) > 0.5)
        alone = len(effect.coefficients) == 1 or len(kind.chosen) == 1
        title = effect.title if alone else f"{effect.title}: {parameter_words(known.name)}"
        number = _made(effect.name, known, title, where, before, value, deviation, spread)
        if lacks_loads(effect, fit.board.views) and number.stands_out:
            number = number.model_copy(update={"probability": NAMED, "stands_out": False})
        yield number


def _centre_of_mass(fit: _Fit, kind: ErrorKind, nominal: RobotModel) -> Iterator[CalibratedNumber]:
    """Where the body's centre of mass is: first moments over the mass."""
    body, one = facts.BODY, np.ones(1, dtype=np.bool_)
    mass, _ = fit.weights(kind.effect.name, "mass_kg", one)
    payloads = [e for e in nominal.effects if isinstance(e, PayloadMass)]
    held_kg = body.mass_kg + sum(float(e.mass_kg) for e in payloads)
    total_kg = max(body.mass_kg, held_kg + fit.found(mass)[0])
    everywhere = np.ones(fit.board.robot.n_joints, dtype=np.bool_)
    for axis, com_m in zip("xyz", body.com_m, strict=True):
        name = f"moment_{axis}_kg_m"
        known = next(p for p in ComOffset.parameters() if p.name == f"{axis}_m")
        moment, published = fit.weights(kind.effect.name, name, one)
        moved, _ = fit.weights(ComOffset.name, known.name, one)
        # The nominal model's payloads have moved it already.
        loaded = sum(float(e.mass_kg) * (float(getattr(e, known.name)) - com_m) for e in payloads) / held_kg
        weights = (moment - (com_m + loaded) * mass) / total_kg + moved
        value, deviation = fit.found(weights)
        if deviation * total_kg > math.sqrt(TAUGHT * float(published @ published)):
            continue
        spread = ERROR_SCALES[kind.effect.name].scales[name] / total_kg
        before = loaded + in_model(nominal, fit.board.robot, ComOffset, known, everywhere)
        title = f"centre of mass of the body: {axis}"
        yield _made(ComOffset.name, known, title, "body", before, value, deviation, spread)


def _made(
    effect: str, known: Parameter, title: str, where: str, before: float, change: float, deviation: float, spread: float
) -> CalibratedNumber:
    """The number from its change against the nominal one, ``before``."""
    value, low, high = _interval(change, deviation, known, before)
    odd = is_odd(change / spread, deviation / spread)
    spread *= before if known.null == 1.0 else 1.0
    return CalibratedNumber(
        effect=effect,
        parameter=known.name,
        title=title,
        where=where,
        nominal=before,
        value=value,
        low=low,
        high=high,
        unit=_unit(known),
        spread=spread,
        probability=odd,
        stands_out=odd > NAMED,
    )


def is_odd(size: float, error: float) -> float:
    """Probability that a number is out of the ordinary: anything in its realistic range, or within its spread.

    Args:
        size: Its change against the nominal one, in published spreads.
        error: Standard deviation of that.
    """
    wide, ordinary = (math.hypot(s, error) for s in (LARGEST_IN_SPREADS, 1.0))
    log_odds = math.log(ODD / (1.0 - ODD)) + math.log(ordinary / wide)
    log_odds += 0.5 * size**2 * (ordinary**-2 - wide**-2)
    return float(expit(log_odds))


def _interval(change: float, deviation: float, known: Parameter, before: float) -> tuple[float, float, float]:
    """Value and 90 % interval of a number that was ``before``, within the parameter's bounds.

    Numbers whose null value is 1 are factors, and multiply.
    """
    low, high = with_formula_error(change, change - Z_90 * deviation, change + Z_90 * deviation, 0.0)
    totals = [before * (1.0 + x) if known.null == 1.0 else before + x for x in (change, low, high)]
    value, low, high = (float(np.clip(x, known.low, known.high)) for x in totals)
    return value, low, high


def _parameter(kind: ErrorKind, c: int) -> tuple[Parameter, str] | None:
    """The parameter that a coefficient moves, and its name again where the coefficient is a multiple of the shape's."""
    known = {p.name: p for p in kind.effect.effect.parameters()}
    coefficient = kind.effect.coefficients[c]
    if coefficient.is_free:
        return (known[coefficient.name], "") if coefficient.name in known else None
    name = next(iter(kind.at.keys() & known.keys()))
    return known[name], name


def _places(robot: JointGroups, effect: LibraryEffect, coefficient: str) -> list[tuple[str, Flags]]:
    """Joint types; zeros joint by joint; legs, or the body."""
    if effect.location is Location.JOINT and coefficient not in ZEROS:
        return list(robot.types().items())
    return _units(robot, effect, coefficient)


def _units(robot: JointGroups, effect: LibraryEffect, _coefficient: str) -> list[tuple[str, Flags]]:
    """Joint by joint, or leg by leg; the body, or the floor."""
    units = robot.units(effect.location)
    if effect.location is Location.ROBOT:
        return [("body", np.ones(1, dtype=np.bool_))]
    if effect.name in NOT_OF_THE_ROBOT:
        return [("floor", np.ones(len(units), dtype=np.bool_))]
    names = [robot.named(u > 0.5)[0] for u in units]
    if effect.location is Location.LEG:
        names = [name.rsplit("_", 1)[0] for name in names]
    return list(zip(names, np.eye(len(units), dtype=np.bool_), strict=True))


def _singled_out(scored: Scored, effect: LibraryEffect, units: Flags) -> Flags:
    """Those of some units, at most half of them, that have a difference of the effect; shape (U,)."""
    out = np.zeros(len(units), dtype=np.bool_)
    for term in scored.terms:
        if term.effect.name == effect.name:
            there = (term.place > 0.5) & units
            out |= there & (2 * there.sum() <= units.sum())
    return out


def in_model(model: RobotModel, robot: JointGroups, effect: type[Effect], known: Parameter, joints: Flags) -> float:
    """A number as a model has it, the mean over some joints, shape (J,); its null value where no effect holds it."""
    total = np.full(robot.n_joints, known.null)
    if robot.joint_names == facts.JOINT_NAMES:
        for e in model.effects:
            if isinstance(e, effect):
                value = np.broadcast_to(getattr(e, known.name), (1, robot.n_joints))[0]
                total = np.where(e.mask, total * value if known.null == 1.0 else total + value, total)
    return float(total[joints].mean())


def _unit(known: Parameter) -> str:
    return "" if known.unit == "1" else known.unit


def parameter_numbers(scorer: Scorer, scored: Scored) -> dict[str, Number]:
    """Parameters of the last term beside the scorer's, each with a 90 % interval.

    Of a linear number it comes from the posterior; of a shape from the shapes around it whose value is almost as large,
    step by step, since numbers that make up for each other are as good along a line; of both from what a formula is
    usually wrong by, ``PARAMETER_SPREAD``.
    """
    term, own = scored.terms[-1], scored.coefficients[-1]
    error = np.sqrt(np.maximum(np.diag(posterior_covariance(scorer.board, scored))[-len(own) :], 0.0))
    best = term.effect.values(own, term.shape)
    low, high = dict(best), dict(best)
    ends: dict[tuple[str, bool], Shape] = {}

    def widen(coefficients: Array, shape: Shape) -> None:
        for name, value in term.effect.values(coefficients, shape).items():
            if value < low[name]:
                low[name], ends[name, False] = value, shape
            if value > high[name]:
                high[name], ends[name, True] = value, shape

    for i, c in enumerate(term.effect.coefficients):
        for sign in (-1.0, 1.0):
            moved = own.copy()
            moved[i] = np.clip(moved[i] + sign * Z_90 * error[i], c.low, c.high)
            widen(moved, term.shape)
    around, done, n_tried = {key_of(term.effect, term.shape): term.shape}, set[tuple[object, ...]](), 0
    while around and n_tried < MOST_SHAPES:
        done |= around.keys()
        for shape in [s for end in around.values() for s in term.effect.refined(end)]:
            n_tried += 1
            other = scorer.scored(term.effect, shape, term.place)
            if other.value > scored.value - PROFILE_NATS:
                widen(other.coefficients[-1], shape)
        around = {key: s for s in ends.values() if (key := key_of(term.effect, s)) not in done}
    units = {p.name: p.unit for p in term.effect.effect.parameters()}
    nulls = {p.name: p.null for p in term.effect.effect.parameters()}
    found = {}
    for name, v in best.items():
        wide = with_formula_error(float(v), float(low[name]), float(high[name]), nulls.get(name, 0.0))
        found[name] = Number(value=float(v), low=wide[0], high=wide[1], unit=units.get(name, ""))
    return found


def with_formula_error(value: float, low: float, high: float, null: float) -> tuple[float, float]:
    """An interval widened by what formulas are usually wrong by, counted from where the effect vanishes.

    The null value of a limit that is never met is no place to count from; zero is, then.
    """
    formula = Z_90 * PARAMETER_SPREAD * abs(value - null if abs(null) < NEVER_MET else value)
    return value - math.hypot(value - low, formula), value + math.hypot(high - value, formula)


def held_sentences(board: Evidence, scored: Scored) -> tuple[str, ...]:
    """Numbers of the differences that lie at the end of what is physically possible, a sentence each."""
    out = []
    for term, own in zip(scored.terms, scored.coefficients, strict=True):
        known, values = {p.name: p for p in term.effect.effect.parameters()}, term.effect.values(own, term.shape)
        at_end = {n: v for n, v in values.items() if n in known and known[n].null != v in (known[n].low, known[n].high)}
        where = ", ".join(board.robot.named(board.robot.joints_of(term.effect, term.place)))
        for name, bound in {**at_end, **within(term.effect, values)[1]}.items():
            size = f"{bound:.4g} {_unit(known[name])}".rstrip()
            what = f"{term.effect.title} at {where}: the {parameter_words(name)}"
            out.append(f"{what} is held at {size}, the end of what can be")
    return tuple(out)
