"""Which experiment tells most: candidates simulated, checked, improved and ranked.

How much an experiment tells of the cause: mutual information of cause and run, by simulation.

With x a run's signature and h its cause, x | h is taken as normal with one covariance for all causes: the scatter of
robots of one cause (ordinary errors, sizes of effects, noise). Two causes lie Δ apart, in standard deviations along the
direction that parts them best, and

    I ≥ −Σᵢ wᵢ log₂ Σⱼ wⱼ exp(−Δᵢⱼ²/8)

is a lower bound of the mutual information (Kolchinsky and Tracey 2017, by Bhattacharyya distances). A few robots find
no direction in two hundred numbers, so each number counts by itself, and only where it sets the two causes apart by
:data:`CLEAR` standard errors. Δ is measured on robots that the choice of the direction did not see: a direction that is
not the best makes the bound loose, not optimistic. One run in ten counts as odd, and tells nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np
from scipy.optimize import minimize
from scipy.special import ndtr
from scipy.stats import entropy

from diagnosis.decision_constants import FORMULA_ERROR, ODD_RUN
from diagnosis.next.candidates import Candidate, Motion, candidates, given
from diagnosis.next.robots import Cause, Robots, beliefs, drawn_robots, suspects
from diagnosis.next.trial import burden, refusals, signature, try_on
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
    told: Information
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

    @property
    def information(self) -> str:
        """What it would tell, in words."""
        return f"{self.told.bits:.2f} of {self.told.of_bits:.2f} bits in {self.robot_s:.0f} s of robot time"

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
    told = Information(0.0, 0.0, np.zeros((len(robots.weights),) * 2))
    motion = candidate.motion()
    try:
        runs = try_on(motion, robots.models, policy, np.random.default_rng([seed, 1]))
    except BadInputError as error:
        return Proposal(candidate, motion, told, "", (str(error),))
    signatures = np.array([signature(run) for run in runs])
    if len(robots.causes) > 1 and np.isfinite(signatures).all():
        told = information_of(signatures, robots.cause_of, robots.weights, np.random.default_rng([seed, 2]))
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


FOLDS: Final = 3
CLEAR: Final = 3.0
ENOUGH: Final = 0.8
REDRAWN: Final = 6
"""Draws of folds, and of what formulas leave, over which Δ is averaged."""


@dataclass(frozen=True)
class Information:
    """What one run of an experiment tells, on average."""

    bits: float
    of_bits: float
    """Entropy of the causes before."""
    apart: Array
    """Δ of each two causes, shape (C, C)."""

    @property
    def is_enough(self) -> bool:
        """Whether it is nearly all that one run can tell: a better experiment is not worth looking for."""
        return self.bits >= ENOUGH * (1.0 - ODD_RUN) * self.of_bits

    def right(self, first: int, second: int) -> float:
        """How often a run tells these two causes apart rightly."""
        return float((1.0 - ODD_RUN) * ndtr(0.5 * self.apart[first, second]) + 0.5 * ODD_RUN)


def information_of(signatures: Array, cause_of: Array, weights: Array, rng: np.random.Generator) -> Information:
    """What an experiment tells.

    Args:
        signatures: One a robot, shape (n, k), in units of what formulas leave.
        cause_of: Cause of each robot, shape (n,), each cause as often.
        weights: Probabilities of the causes, shape (C,).
        rng: Draws what formulas leave, and folds.
    """
    n_causes = len(weights)
    apart = np.zeros((n_causes, n_causes))
    for _ in range(REDRAWN):
        x = signatures + _formula_errors(signatures, cause_of, rng)
        groups = [x[rng.permutation(np.flatnonzero(cause_of == c))] for c in range(n_causes)]
        folds = []
        for fold in range(FOLDS):
            is_new = [np.arange(len(own)) % FOLDS == fold for own in groups]
            folds.append([(own[~new], own[new]) for own, new in zip(groups, is_new, strict=True)])
        for i, j in combinations(range(n_causes), 2):
            apart[i, j] += _apart(folds, i, j) / REDRAWN
    apart += apart.T
    near = np.exp(-(apart**2) / 8.0) @ weights
    return Information(float((1.0 - ODD_RUN) * -weights @ np.log2(near)), float(entropy(weights, base=2)), apart)


def _apart(folds: Sequence[Sequence[tuple[Array, Array]]], i: int, j: int) -> float:
    """Δ of two causes; ``folds`` has the robots of each cause that are seen and that are new, shapes (n, k)."""
    sides: tuple[list[Array], list[Array]] = [], []
    for groups in folds:
        seen = [own for own, _ in groups]
        left = sum(((own - own.mean(axis=0)) ** 2).sum(axis=0) for own in seen)
        variance = np.maximum(left / sum(len(own) - 1 for own in seen), 1.0)
        first, second = seen[i].mean(axis=0), seen[j].mean(axis=0)
        is_clear = (first - second) ** 2 > CLEAR**2 * variance * (1.0 / len(seen[i]) + 1.0 / len(seen[j]))
        direction = np.where(is_clear, (first - second) / variance, 0.0)
        size = np.sqrt(float(direction**2 @ variance)) or 1.0
        for side, (_, new) in zip(sides, (groups[i], groups[j]), strict=True):
            side.append((new - 0.5 * (first + second)) @ direction / size)
    a, b = map(np.concatenate, sides)
    free = len(a) + len(b) - 2
    variance_along = (np.sum((a - a.mean()) ** 2) + np.sum((b - b.mean()) ** 2)) / free
    if variance_along == 0.0:
        return 0.0
    away = max(float(a.mean() - b.mean()), 0.0)
    # Unbiased: the square of a mean is too large by its variance, one over a variance by free / (free - 2).
    square = (free - 2) / free * away**2 / variance_along - 1.0 / len(a) - 1.0 / len(b)
    return float(np.sqrt(max(square, 0.0)))


def _formula_errors(signatures: Array, cause_of: Array, rng: np.random.Generator) -> Array:
    """Errors of formulas: one unit everywhere, and a share of what sets a cause apart from all others."""
    centre = np.median(signatures, axis=0)
    apart = np.array([signatures[cause_of == c].mean(axis=0) - centre for c in range(int(cause_of.max()) + 1)])
    share = FORMULA_ERROR * rng.standard_normal((len(signatures), 1)) * apart[cause_of]
    return np.asarray(share + rng.standard_normal(signatures.shape))
