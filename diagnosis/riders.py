"""Effects beside stronger ones of which residuals alone do not say enough: closed loops decide whether they are there.

No formula is exact, so beside a strong effect another one finds something to explain. Where it is really there, the
robot walks as the model with it does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from diagnosis.selection.board import Board
from diagnosis.selection.scoring import Scored, Scorer
from diagnosis.selection.search import Selection

WEAK_NATS: Final = 12.0
"""A chosen effect that adds less to stronger ones is in doubt.

Of 8 such in 175 withheld cases five were wrong; of 27 that add more, two.
"""
MAX_DOUBTFUL: Final = 3
"""Effects that were not chosen, and are tried in closed loops all the same."""


@dataclass(frozen=True)
class Rider:
    """An effect in doubt, and the model without it where it was chosen, or with it where it was not."""

    effect: str
    """Its name."""
    scored: Scored
    """The other model."""
    is_added: bool
    """Whether the other model is the one that has it."""

    @property
    def name(self) -> str:
        """Name of the other model."""
        return f"{'with' if self.is_added else 'without'} {self.effect}"

    def advantage(self, distances: Mapping[str, float]) -> float:
        """By how much closed loops with the effect are nearer to the robot, in floors.

        Args:
            distances: Of the models' closed loops, by name; the chosen one is called corrected.
        """
        with_it, without = distances[self.name], distances["corrected"]
        return without - with_it if self.is_added else with_it - without


def riders_of(selection: Selection, board: Board) -> tuple[Rider, ...]:
    """All effects in doubt."""
    if selection.best is None:
        return ()
    terms, gains = selection.best.terms, selection.gains
    weak = [
        Rider(term.effect.name, Scorer(board, terms[:i] + terms[i + 1 :]).now, False)
        for i, (term, gain) in enumerate(zip(terms, gains, strict=True))
        if gain < min(WEAK_NATS, max(gains))
    ]
    more = [
        Rider(r.scored.terms[-1].effect.name, r.scored, True) for r in selection.doubtful[:MAX_DOUBTFUL]
    ]  # fmt: skip
    return (*weak, *more)


def turned(riders: tuple[Rider, ...], distances: Mapping[str, float], clearly: float) -> Rider | None:
    """The effect of which closed loops say most clearly the contrary of what was chosen; None where of none.

    One that was chosen is left out where closed loops are farther off with it; one that was not is added where they
    come clearly nearer.

    Args:
        riders: Those in doubt.
        distances: Of the models' closed loops, by name, in floors.
        clearly: Floors that two runs of one model do not differ by.
    """

    def against(rider: Rider) -> float:
        nearer = rider.advantage(distances)
        return nearer - clearly if rider.is_added else -nearer

    first = max(riders, key=against, default=None)
    return first if first is not None and against(first) > 0.0 else None


__all__ = ["Rider", "riders_of", "turned"]
