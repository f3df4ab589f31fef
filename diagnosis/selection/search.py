"""Forward selection with refit, then drop and swap; and the rivals of each effect that was chosen."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from diagnosis.channels import Array, Shape
from diagnosis.decision_constants import LEAST_NATS_TO_TRY, MAX_EFFECTS
from diagnosis.library import LibraryEffect
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.scoring import Placed, Scored, Scorer, null_of

NEAR_SHARE: Final = 0.1
LEAST_NATS: Final = 1.5
WORTH_SHARE: Final = 0.25
"""An effect whose first try adds less than this share of what the best so far adds is not refined."""
ROUNDS: Final = 5
WEIGHT_ROUNDS: Final = 2
SHAPES_AGAIN: Final = 8
"""Number of coarse shapes that are tried again with sharper weights."""
PER_PARAMETER: Final = 2.0
"""Nats that each further free number must bring."""
PER_UNIT: Final = 1.0
"""Nats that a set of joints costs for each unit by which it differs from the nearest natural set."""

Say = Callable[[str], None]


@dataclass(frozen=True)
class Rival:
    """An effect in place of a chosen one, at its own best place and shape."""

    scored: Scored
    value: float
    """Score less the price of its parameters, nats."""


@dataclass(frozen=True)
class Selection:
    """What was chosen."""

    best: Scored
    """Ordinary errors alone where nothing passed."""
    gains: tuple[float, ...]
    """What each chosen effect adds to the score of the others, nats."""
    rivals: tuple[tuple[Rival, ...], ...]
    """By chosen effect: all effects in its place, best first, itself among them."""
    first: tuple[Rival, ...]
    """All effects alone, best first, whether or not they pass."""


def search(board: Evidence, library: Mapping[str, LibraryEffect], say: Say) -> Selection:
    """Choose effects of a library; progress goes to ``say``."""
    usable = {n: e for n, e in library.items() if e.show(board.views)}
    first = ranked(board, (), usable)
    # What shows nothing alone, whatever the price of its numbers, is not looked for beside others.
    promising = {e.name: e for r in first if r.scored.score > LEAST_NATS for e in [r.scored.terms[-1].effect]}
    best: Scored | None = None
    value, candidates = 0.0, first
    while candidates and candidates[0].value - value > LEAST_NATS_TO_TRY:
        best, value = candidates[0].scored, candidates[0].value
        say(f"+ {best.terms[-1].effect.name}: {value:.0f} nats")
        if len(best.terms) > 1:
            best, value = _swapped(board, best, value, promising)
        if len(best.terms) == MAX_EFFECTS:
            break
        candidates = ranked(board, best.terms, beside(promising, best.terms))
    if best is None:
        return Selection(null_of(board), (), (), first)
    best = _pruned(board, best)
    return selection_of(board, best, first, library)


def selection_of(
    board: Evidence, best: Scored, first: Sequence[Rival], library: Mapping[str, LibraryEffect]
) -> Selection:
    """What each of the fitted effects adds to the others, and its rivals from the library; ``first`` are all alone."""
    usable = {n: e for n, e in library.items() if e.show(board.views)}
    near = _near(first, board) | {t.effect.name for t in best.terms}
    rivals, gains = [], []
    for i in range(len(best.terms)):
        others = best.terms[:i] + best.terms[i + 1 :]
        around = beside({n: e for n, e in usable.items() if n in near}, others)
        rivals.append(ranked(board, others, around) if others else tuple(first))
        gains.append(_worth(best, board) - _value(board, others))
    return Selection(best, tuple(gains), tuple(rivals), tuple(first))


def beside(library: Mapping[str, LibraryEffect], terms: Sequence[Placed]) -> dict[str, LibraryEffect]:
    """Effects that can be there beside the terms: neither one of them, nor contained in one, nor containing one."""
    names = {t.effect.name for t in terms}
    taken = names.union(*(t.effect.contains for t in terms))
    return {n: e for n, e in library.items() if n not in taken and not names & set(e.contains)}


def ranked(board: Evidence, terms: Sequence[Placed], library: Mapping[str, LibraryEffect]) -> tuple[Rival, ...]:
    """Every effect beside the terms at its best place and shape, best first."""
    scorer = Scorer(board, terms)
    found: list[Rival] = []
    top = there = _worth(scorer.now, board) if terms else 0.0
    for effect in library.values():
        rival = best_of(scorer, effect, there + WORTH_SHARE * (top - there))
        if rival is not None:
            found.append(rival)
            top = max(top, rival.value)
    return tuple(sorted(found, key=lambda r: -r.value))


def best_of(scorer: Scorer, effect: LibraryEffect, worth: float = -np.inf) -> Rival | None:
    """The effect at its best place and shape beside the scorer's terms, or None where it shows nowhere.

    Under the value ``worth`` the best coarse shape and natural place are good enough.
    """
    board = scorer.board
    everywhere = np.ones(board.robot.n_joints, dtype=np.bool_)
    places = board.robot.places(effect)
    try:
        shapes = list(effect.shapes(board.views, everywhere))
    except (KeyError, ValueError):
        return None
    if not shapes:
        return None
    best: Rival | None = None
    weights = scorer.weights
    for _ in range(WEIGHT_ROUNDS):
        # Weights follow what is left, so what explains much is judged sharply only in a second round.
        shape, place, shapes = _best_by_weights(scorer, effect, shapes, places, weights)
        if best is not None:
            place = _grown(scorer, effect, shape, place, weights)
        scored, weights = scorer.with_weights(effect, shape, place)
        rival = Rival(scored, _worth(scored, board))
        if best is not None and rival.value <= best.value:
            break
        best = rival
        if rival.value < worth:
            break
    if best is not None and not effect.is_there(best.scored.coefficients[-1], best.scored.terms[-1].shape):
        return None
    return best


def _best_by_weights(
    scorer: Scorer, effect: LibraryEffect, shapes: Sequence[Shape], places: Array, weights: Array
) -> tuple[Shape, Array, list[Shape]]:
    """The shape and natural place that explain most under given weights, refined around the best shape.

    Beside them the best of the shapes, for another round.
    """
    best: tuple[float, Array, Shape] = (-np.inf, places[0], shapes[0])
    tried: dict[tuple[tuple[str, float], ...], float] = {}

    def attempt(shape: Shape, where: Array) -> bool:
        nonlocal best
        key = tuple(sorted(shape.items()))
        if key in tried:
            return False
        gains = scorer.gains(effect, shape, where, weights)
        at = int(np.argmax(gains))
        tried[key] = float(gains[at])
        if gains[at] > best[0] + 1e-6:
            best = (float(gains[at]), where[at], shape)
            return True
        return False

    for shape in shapes:
        attempt(shape, places)
    again = sorted(shapes, key=lambda s: -tried[tuple(sorted(s.items()))])[:SHAPES_AGAIN]
    for _ in range(ROUNDS):
        moved = [attempt(shape, best[1][None]) for shape in effect.refined(best[2])]
        if not any(moved):
            break
    return best[2], best[1], again


def _grown(scorer: Scorer, effect: LibraryEffect, shape: Shape, place: Array, weights: Array) -> Array:
    """Add or drop one unit at a time while that pays for itself."""
    natural = scorer.board.robot.places(effect)

    def values_of(options: Array) -> Array:
        return scorer.gains(effect, shape, options, weights) - PER_UNIT * _distances(options, natural)

    if len(place) == 1 or effect.singly:
        return place
    value = float(values_of(place[None])[0])
    for _ in range(len(place)):
        options = np.abs(place[None] - np.eye(len(place)))
        options = options[options.any(axis=1)]
        values = values_of(options)
        at = int(np.argmax(values))
        if values[at] <= value + 1e-6:
            break
        place, value = options[at], float(values[at])
    return place


def _near(first: Sequence[Rival], board: Evidence) -> set[str]:
    """Effects that alone explain at least a tenth of what the best explains, or the best in some channel."""
    top = max(first[0].value, 1.0)
    names = {r.scored.terms[-1].effect.name for r in first if r.value > NEAR_SHARE * top}
    for numbers in board.by_channel.values():
        if first:
            names.add(max(first, key=lambda r: float(r.scored.by_block[numbers].sum())).scored.terms[-1].effect.name)
    return names


def _distances(places: Array, natural: Array) -> Array:
    """Units by which each place differs from the nearest natural set; (L, U) to (L,)."""
    return np.asarray(np.abs(natural - places[:, None]).sum(axis=2).min(axis=1))


def price(terms: Sequence[Placed], board: Evidence) -> float:
    """Nats that a set of effects costs: its free numbers, and joints that are no natural set."""
    return sum(
        PER_PARAMETER * t.n_parameters + PER_UNIT * float(_distances(t.place[None], board.robot.places(t.effect))[0])
        for t in terms
    )


def _worth(scored: Scored, board: Evidence) -> float:
    return scored.score - price(scored.terms, board)


def _value(board: Evidence, terms: Sequence[Placed]) -> float:
    return _worth(Scorer(board, terms).now, board) if terms else 0.0


def _swapped(board: Evidence, best: Scored, value: float, library: Mapping[str, LibraryEffect]) -> tuple[Scored, float]:
    """Each earlier effect chosen anew beside the later ones, shape and place included; the last one if any changed."""
    before, last = value, len(best.terms) - 1
    for i in range(len(best.terms)):
        others = best.terms[1:]
        is_same = i == last and value == before
        ranking = () if is_same else ranked(board, others, beside(library, others))
        if ranking and ranking[0].value > value:
            best, value = ranking[0].scored, ranking[0].value
        else:
            best = Scorer(board, (*others, best.terms[0])).now
    return best, value


def _pruned(board: Evidence, best: Scored) -> Scored:
    """Without effects that no longer add enough."""
    while len(best.terms) > 1:
        value = _worth(best, board)
        losses = [value - _value(board, best.terms[:i] + best.terms[i + 1 :]) for i in range(len(best.terms))]
        weakest = int(np.argmin(losses))
        if losses[weakest] > LEAST_NATS_TO_TRY:
            break
        best = Scorer(board, best.terms[:weakest] + best.terms[weakest + 1 :]).now
    return best
