"""Which experiment tells most: candidates simulated, checked, improved and ranked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np
from scipy.optimize import minimize

from diagnosis.next.choose.candidates import Candidate, Motion, candidates, given
from diagnosis.next.choose.information import Told, told_by
from diagnosis.next.choose.robots import Cause, Robots, beliefs, drawn_robots, suspects
from diagnosis.next.choose.signature import signature
from diagnosis.next.choose.trial import burden, refusals, try_on
from diagnosis.verdict.posterior_file import Posterior
from spot_model.errors import BadInputError
from spot_model.policy.policy import Policy
from spot_model.robot.facts import Array

EACH: Final = 6
"""Robots of each cause, at least."""
ROBOTS: Final = 24
"""Of all causes together: few robots hide small differences. For 0.03 rad of backlash in a knee or none, walking to and
fro told 0.01 bits with six robots of each cause, 0.12 with twelve, 0.18 with 24."""
TRIES: Final = 5
"""Simulations in which the numbers of the best kind are chosen."""
WORTH_BITS: Final = 0.05
"""An experiment that tells less is not worth anybody's time."""
Tell = Callable[[float], None]


@dataclass(frozen=True)
class Proposal:
    """An experiment with what it would tell, and what it loads on the robot."""

    candidate: Candidate
    motion: Motion
    told: Told
    burden: str
    refused: tuple[str, ...] = ()
    """Why it must not be run; empty where it may."""
    is_proved: bool = False
    """Whether robots with wide errors bear it, too."""

    @property
    def robot_s(self) -> float:
        """Robot time, s."""
        return self.candidate.robot_s

    @property
    def is_promising(self) -> bool:
        """Whether nothing was found against it so far, and it tells enough or is a user's own."""
        return not self.refused and (self.told.bits >= WORTH_BITS or self.candidate.is_own)

    @property
    def is_worthwhile(self) -> bool:
        """Whether it may be run, and should be."""
        return self.is_promising and self.is_proved

    @property
    def values(self) -> str:
        """Its chosen numbers, in words."""
        units = {name: free.unit for name, free in self.candidate.free.items()}
        return ", ".join(f"{n.partition('_')[0]} {v:g} {units[n]}" for n, v in self.candidate.chosen.items())

    @property
    def bits_a_second(self) -> float:
        """Bits of the cause for each second of robot time."""
        return self.told.bits / self.robot_s

    def decides(self, causes: Sequence[Cause], weights: Array) -> str:
        """Which two causes it sets apart most, in words, with how it does."""
        if len(causes) < 2:
            return "nothing: one cause is left"
        i, j = max(
            combinations(range(len(causes)), 2),
            key=lambda p: weights[p[0]] * weights[p[1]] * (self.told.right(*p) - 0.5),
        )
        right = self.told.right(i, j)
        return f"{in_words(causes[i])} from {in_words(causes[j])} (decided correctly in {100.0 * right:.0f} %)"


@dataclass(frozen=True)
class Design:
    """All that was looked at, the most telling first; refused ones last."""

    causes: tuple[Cause, ...]
    weights: Array
    proposals: tuple[Proposal, ...]

    @property
    def odds(self) -> dict[str, float]:
        """Probability of each cause, by its words."""
        return {in_words(c): float(w) for c, w in zip(self.causes, self.weights, strict=True)}

    @property
    def worthwhile(self) -> tuple[Proposal, ...]:
        """Those that may be run and tell enough, or that a user asks for, the most telling first."""
        return tuple(p for p in self.proposals if p.is_worthwhile)


def in_words(cause: Cause) -> str:
    """A cause for a person."""
    return " and ".join(name.replace("_", " ") for name in cause) if cause else "ordinary errors alone"


def design(
    posterior: Posterior,
    policy: Policy | None,
    seed: int,
    tell: Tell = lambda _: None,
    *,
    excluded: Sequence[str] = (),
    own: Motion | None = None,
    wanted: int | None = None,
    most_s: float = float("inf"),
) -> Design:
    """Rank the experiments that could be next, and prove them on robots with wide errors, the most telling first.

    Args:
        posterior: What is still possible.
        policy: For walks; without it only joint experiments are looked at.
        seed: Of all draws; each candidate meets the same robots, noise and delays.
        tell: Called with the share that is done.
        excluded: Names of candidates that are left out.
        own: A user's own experiment, in the place of all others.
        wanted: So many are proved; by default all that tell enough.
        most_s: Of robot time; longer ones are not proved.
    """
    each = max(EACH, ROBOTS // max(2, len(beliefs(posterior))))
    robots = drawn_robots(posterior, each, np.random.default_rng(seed))
    effects = {name for cause in robots.causes for name in cause}
    all_of = candidates(policy.contract if policy is not None else None, suspects(posterior), effects)
    kinds = [c for c in all_of if c.name not in excluded] if own is None else [given(own)]
    n_steps = len(kinds) + TRIES + 2
    found: list[Proposal] = []
    for done, candidate in enumerate(kinds, start=1):
        found.append(judged(candidate, robots, policy, seed))
        tell(done / n_steps)
    if len(robots.causes) > 1 and own is None and found:
        number = min(range(len(found)), key=lambda i: _rank(found[i]))
        if not found[number].told.is_enough:
            found[number] = _improved(found[number], robots, policy, seed)
    tell((n_steps - 2) / n_steps)
    ranked = sorted(found, key=_rank)
    for at, proposal in enumerate(ranked):
        if wanted is not None and sum(p.is_worthwhile for p in ranked) >= wanted:
            break
        if proposal.is_promising and proposal.robot_s <= most_s:
            ranked[at] = proved(proposal, robots, policy, seed)
    tell(1.0)
    return Design(robots.causes, robots.weights, tuple(sorted(ranked, key=_rank)))


def judged(candidate: Candidate, robots: Robots, policy: Policy | None, seed: int) -> Proposal:
    """What a candidate tells and loads, and whether all robots that the logs allow bear it."""
    told = Told(0.0, 0.0, np.zeros((len(robots.weights),) * 2))
    motion = candidate.motion()
    try:
        runs = try_on(motion, robots.models, policy, np.random.default_rng([seed, 1]))
    except BadInputError as error:
        return Proposal(candidate, motion, told, "", (str(error),))
    signatures = np.array([signature(run) for run in runs])
    if len(robots.causes) > 1 and np.isfinite(signatures).all():
        told = told_by(signatures, robots.cause_of, robots.weights, np.random.default_rng([seed, 2]))
    return Proposal(candidate, motion, told, burden(runs), refusals(runs))


def proved(proposal: Proposal, robots: Robots, policy: Policy | None, seed: int) -> Proposal:
    """The proposal, refused if one of the robots with wide errors does not bear it."""
    runs = try_on(proposal.motion, robots.wide, policy, np.random.default_rng([seed, 3]))
    return replace(proposal, refused=refusals(runs), is_proved=True)


def _rank(proposal: Proposal) -> tuple[bool, float]:
    return bool(proposal.refused), -proposal.bits_a_second


def _improved(start: Proposal, robots: Robots, policy: Policy | None, seed: int) -> Proposal:
    """The best of some tries by Nelder and Mead's method within the candidate's bounds; never one that is refused."""
    free, best = start.candidate.free, start
    low = np.array([own.low for own in free.values()])
    width = np.array([own.high for own in free.values()]) - low

    def loss(x: Array) -> float:
        nonlocal best
        values = {n: round(float(v), 3) for n, v in zip(free, low + x * width, strict=True)}
        proposal = judged(replace(start.candidate, values=values), robots, policy, seed)
        if _rank(proposal) < _rank(best):
            best = proposal
        return 0.0 if proposal.refused else -proposal.bits_a_second

    x = (np.array(list(start.candidate.chosen.values())) - low) / width
    simplex = np.clip(x + np.concatenate([np.zeros((1, len(x))), np.where(x < 0.5, 0.4, -0.4) * np.eye(len(x))]), 0, 1)
    options = {"maxfev": TRIES, "initial_simplex": simplex}
    minimize(loss, x, method="Nelder-Mead", bounds=[(0.0, 1.0)] * len(x), options=options)
    return best
