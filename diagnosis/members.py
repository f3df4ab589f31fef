"""Members of a group of effects that the residuals cannot tell apart: closed loops of each decide who stands first.

A lost command and one that waits too long leave the same stamps, but a robot on the one walks as it did, and on the
other it does not. So each member takes the chosen effect's place in a model of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from diagnosis.posterior import Calibration, Group, Posterior
from diagnosis.selection.search import Rival, Selection

PER_FLOOR: Final = 1.0
"""Nats by which a member's odds fall for each floor that its closed loops are farther off."""


@dataclass(frozen=True)
class Member:
    """A rival in the place of a chosen effect."""

    place: int
    """Number of the chosen effect."""
    rival: Rival
    distance: float = np.inf
    """Of its closed loops to the robot's, in floors."""
    chosen_distance: float = np.inf
    """The same with the effect that was chosen."""

    @property
    def effect(self) -> str:
        """Name of the effect."""
        return self.rival.scored.terms[-1].effect.name

    @property
    def name(self) -> str:
        """Name of its model."""
        return f"{self.effect} in place {self.place}"


def members_of(selection: Selection, groups: Sequence[Group]) -> tuple[Member, ...]:
    """All members but those that were chosen."""
    if selection.best is None:
        return ()
    return tuple(
        Member(place, rival)
        for place, (group, rivals, term) in enumerate(
            zip(groups, selection.rivals, selection.best.terms, strict=True)
        )
        for rival in rivals
        if (name := rival.scored.terms[-1].effect.name) in group.names and name != term.effect.name
    )  # fmt: skip


def with_member(selection: Selection, member: Member) -> Selection:
    """The selection with a member in its place, which comes last."""
    order = [i for i in range(len(selection.rivals)) if i != member.place] + [member.place]
    ranking = selection.rivals[member.place]
    first = (member.rival, *(r for r in ranking if r is not member.rival))
    rivals = tuple(first if i == member.place else selection.rivals[i] for i in order)
    return replace(
        selection, best=member.rival.scored, gains=tuple(selection.gains[i] for i in order), rivals=rivals
    )  # fmt: skip


def after_members(
    found: Posterior, members: Sequence[Member], winner: Member | None, calibration: Calibration
) -> Posterior:
    """Odds within the groups, knowing the closed loops; the winner's place comes last, as in its selection.

    Args:
        found: From the residuals alone.
        members: With their distances.
        winner: Who takes the chosen effect's place; None where nobody does.
        calibration: Numbers.
    """
    groups = list(found.groups)
    for place, group in enumerate(groups):
        mine = {m.effect: m for m in members if m.place == place}
        if not mine:
            continue
        chosen = next(iter(mine.values())).chosen_distance
        odds = {
            name: p * float(np.exp(-PER_FLOOR * ((mine[name].distance if name in mine else chosen) - chosen)))
            for name, p in group.probabilities.items()
        }
        total = sum(odds.values())
        probabilities = {name: p / total for name, p in sorted(odds.items(), key=lambda item: -item[1])}
        first = winner.effect if winner is not None and winner.place == place else group.names[0]
        near = [n for n in group.names if n != first and odds[n] >= calibration.group_odds * odds[first]]
        groups[place] = replace(group, names=(first, *near), probabilities=probabilities)
    if winner is not None:
        groups.append(groups.pop(winner.place))
    return replace(found, groups=tuple(groups))


__all__ = ["Member", "after_members", "members_of", "with_member"]
