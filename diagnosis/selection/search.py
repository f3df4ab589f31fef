"""The set of effects with the largest marginal likelihood: forward, with exchange; and rivals of each that was chosen.

Every number is tried alone with its wide prior, beside what was chosen already, at all of its places and shapes. So a
fault at one joint is found at that joint, though the ordinary errors of a whole leg could take it up together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from diagnosis.channels import Array, Channel, Flags, Shape
from diagnosis.library import LibraryEffect
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.scoring import Placed, Scored, Scorer, null_of, prices

WORTH_SHARE: Final = 0.25
"""An effect whose first try adds less than this share of what the best so far adds is not refined."""
HOPELESS: Final = 5.0
"""Where the best coarse shape lacks so many nats of its price, no finer one is tried."""
SHAPES_AGAIN: Final = 8
"""Number of coarse shapes that are tried again with sharper weights."""

Say = Callable[[str], None]


@dataclass(frozen=True)
class Selection:
    """What was chosen."""

    best: Scored
    """Ordinary errors alone where nothing passed."""
    gains: Mapping[str, float]
    """By chosen effect, what it adds to the value of the others, nats."""
    channels: Mapping[str, Mapping[Channel, float]]
    """By chosen effect and channel, what it adds there, nats."""
    rivals: Mapping[str, tuple[Scored, ...]]
    """By chosen effect: sets with each effect in its place, best first, itself among them."""
    first: tuple[Scored, ...]
    """All effects alone, best first, whether or not they pass."""


def search_effects(board: Evidence, library: Mapping[str, LibraryEffect], say: Say) -> Selection:
    """Choose effects of a library; progress goes to ``say``."""
    usable = {n: e for n, e in library.items() if board.sees(e)}
    first = ranked(board, (), usable)
    best, candidates = null_of(board), first
    while candidates and candidates[0].value > max(best.value, 0.0) and len(best.terms) < 6:
        best = candidates[0]
        say(f"found: {best.terms[-1].effect.title}")
        if len(best.terms) > 1:
            best = _pruned(board, _exchanged(board, best, usable))
        candidates = ranked(board, best.terms, beside(usable, best.terms))
    return selection_of(board, best, first, usable)


def selection_of(
    board: Evidence, best: Scored, first: Sequence[Scored], library: Mapping[str, LibraryEffect]
) -> Selection:
    """What each of the fitted effects adds to the others, and its rivals from the library; ``first`` are all alone."""
    near = _near(first, board) | set(effects_of(best.terms))
    rivals, gains, channels = {}, {}, {}
    for name in effects_of(best.terms):
        others = [t for t in best.terms if t.effect.name != name]
        around = beside({n: e for n, e in library.items() if n in near and board.sees(e)}, others)
        rivals[name] = ranked(board, others, around) if others else tuple(first)
        less = Scorer(board, others).now if others else None
        gains[name] = best.value - (less.value if less else 0.0)
        by_block = best.by_block - (less.by_block if less else 0.0)
        channels[name] = {c: float(by_block[n].sum()) for c, n in board.by_channel.items()}
    return Selection(best, gains, channels, rivals, tuple(first))


def effects_of(terms: Sequence[Placed]) -> tuple[str, ...]:
    """Names of the terms' effects, each once: one that acts with different numbers at different joints has several."""
    return tuple(dict.fromkeys(t.effect.name for t in terms))


def beside(library: Mapping[str, LibraryEffect], terms: Sequence[Placed]) -> dict[str, LibraryEffect]:
    """Effects that can be there beside the terms: neither contained in one of them, nor containing one."""
    names = set(effects_of(terms))
    taken = set().union(*(t.effect.contains for t in terms))
    return {n: e for n, e in library.items() if n not in taken and not names & set(e.contains)}


def ranked(board: Evidence, terms: Sequence[Placed], library: Mapping[str, LibraryEffect]) -> tuple[Scored, ...]:
    """Every effect beside the terms at its best place and shape, best first."""
    scorer = Scorer(board, terms)
    found: list[Scored] = []
    top = there = scorer.now.value if terms else 0.0
    for effect in library.values():
        rival = best_of(scorer, effect, there + WORTH_SHARE * (top - there))
        if rival is not None:
            found.append(rival)
            top = max(top, rival.value)
    return tuple(sorted(found, key=lambda r: -r.value))


def best_of(scorer: Scorer, effect: LibraryEffect, worth: float = -np.inf) -> Scored | None:
    """The effect at its best place and shape beside the scorer's terms, or None where it shows nowhere.

    Under the value ``worth`` the best coarse shape and natural place are good enough.
    """
    board = scorer.board
    shapes, places = list(board.shapes(effect)), board.robot.places(effect)
    # Where it acts already, it has its number.
    taken = [t.place > 0.0 for t in scorer.terms if t.effect.name == effect.name]
    free = ~np.any([np.zeros(places.shape[1], dtype=np.bool_), *taken], axis=0)
    places = places[~(places * ~free).any(axis=1)]
    best: Scored | None = None
    weights = scorer.weights
    for _ in range(2 if shapes and len(places) else 0):
        # Weights follow what is left, so what explains much is judged sharply only in a second round.
        shape, place, shapes = _best_by_weights(scorer, effect, shapes, places, weights)
        if best is not None:
            place = _grown(scorer, effect, shape, place, weights, free)
        scored = scorer.scored(effect, shape, place)
        weights = scored.weights
        if best is not None and scored.value <= best.value:
            break
        best = scored
        if best.value < worth:
            break
    if best is not None and not effect.is_there(best.coefficients[-1], best.terms[-1].shape):
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
        is_better = bool(gains[at] > best[0] + 1e-6)
        best = (float(gains[at]), where[at], shape) if is_better else best
        return is_better

    for shape in shapes:
        attempt(shape, places)
    again = sorted(shapes, key=lambda s: -tried[tuple(sorted(s.items()))])[:SHAPES_AGAIN]
    is_near = best[0] > float(prices(scorer.board, effect, best[1][None])[0]) - HOPELESS
    for _ in range(5 if is_near else 0):
        if not any([attempt(shape, best[1][None]) for shape in effect.refined(best[2])]):  # noqa: C419 - each is tried
            break
    return best[2], best[1], again


def _grown(scorer: Scorer, effect: LibraryEffect, shape: Shape, place: Array, weights: Array, free: Flags) -> Array:
    """Add or drop one unit at a time, of those that are free, while that pays for itself."""

    def values_of(options: Array) -> Array:
        return scorer.gains(effect, shape, options, weights) - prices(scorer.board, effect, options)

    if len(place) == 1 or effect.singly:
        return place
    value = float(values_of(place[None])[0])
    for _ in range(len(place)):
        options = np.abs(place[None] - np.eye(len(place)))
        options = options[options.any(axis=1) & ~(options * ~free).any(axis=1)]
        values = values_of(options)
        at = int(np.argmax(values))
        if values[at] <= value + 1e-6:
            break
        place, value = options[at], float(values[at])
    return place


def _near(first: Sequence[Scored], board: Evidence) -> set[str]:
    """Effects that alone explain at least a tenth of what the best explains, or the best in some channel."""
    top = max(first[0].value, 1.0) if first else 1.0
    names = {r.terms[-1].effect.name for r in first if r.value > 0.1 * top}
    for numbers in board.by_channel.values() if first else ():
        names.add(max(first, key=lambda r: float(r.by_block[numbers].sum())).terms[-1].effect.name)
    return names


def _exchanged(board: Evidence, best: Scored, library: Mapping[str, LibraryEffect]) -> Scored:
    """Each earlier effect chosen anew beside the later ones, shape and place included; the last one if any changed."""
    before, last = best.value, len(best.terms) - 1
    for i in range(len(best.terms)):
        others = best.terms[1:]
        is_same = i == last and best.value == before
        ranking = () if is_same else ranked(board, others, beside(library, others))
        is_better = bool(ranking) and ranking[0].value > best.value
        best = ranking[0] if is_better else Scorer(board, (*others, best.terms[0])).now
    return best


def _pruned(board: Evidence, best: Scored) -> Scored:
    """Without effects that no longer add anything."""
    while len(best.terms) > 1:
        fewer = [Scorer(board, best.terms[:i] + best.terms[i + 1 :]).now for i in range(len(best.terms))]
        losses = [best.value - scored.value for scored in fewer]
        if min(losses) > 0.0:
            break
        best = fewer[int(np.argmin(losses))]
    return best
