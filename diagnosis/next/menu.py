"""The menu, weighed: a run of each recording is simulated, and what it would leave in doubt is worked out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from diagnosis.decision_constants import NAMED
from diagnosis.document import Verdict
from diagnosis.library import LibraryEffect
from diagnosis.next.candidates import Candidate, Motion, candidates, given
from diagnosis.next.doubts import WORTH, Doubt, Key, doubts_of, known
from diagnosis.next.trial import burden, is_held, refusals, try_on, wide_robots
from diagnosis.report import words
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.normal_equations import one_thread
from diagnosis.verdict.explanation import evidence_of
from diagnosis.verdict.posterior_file import Posterior
from spot_log.read.run import Run
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy
from spot_model.robot.facts import JOINT_NAMES
from trainer.signals.policy_ticks import tick_period_s


class Diagnosed(NamedTuple):
    """A diagnosis with what it was made of."""

    verdict: Verdict
    posterior: Posterior
    robots: tuple[RobotModel, ...]
    """Those that the logs allow; the first is the corrected model."""
    nominal: RobotModel
    library: Mapping[str, LibraryEffect]
    runs: tuple[Run, ...]
    policy: Policy | None
    """For walks; without it only the standing robot is recorded."""


class Recording(NamedTuple):
    """A recording with what it would leave in doubt."""

    candidate: Candidate
    doubts: tuple[Doubt, ...]
    """What it lowers most first."""
    after: Mapping[Key, float]
    """Expected half-widths by number."""
    loads: str = ""
    refused: tuple[str, ...] = ()
    """Why it must not be run; empty where nothing was found against it."""
    is_held: bool = False
    """Whether the logs hold it already."""

    @property
    def drops(self) -> list[float]:
        """Share by which it lowers each doubt; below 0 where it dilutes what the logs show."""
        return [1.0 - self.after[d.key] / d.now for d in self.doubts]

    @property
    def gain(self) -> float:
        """Mean of these shares, by which recordings are ranked: a person's time goes with runs, not with seconds."""
        return float(np.mean(self.drops or [0.0]))

    @property
    def is_worth(self) -> bool:
        """Whether it should be run if it is safe, or was asked for."""
        return not self.refused and (self.candidate.is_own or max(self.drops, default=0.0) >= WORTH)

    @property
    def told(self) -> list[str]:
        """What it does to each doubt, in words."""
        return [f"{d.title}: {d.told(d.now)} now, {d.told(self.after[d.key])} expected" for d in self.doubts]

    @property
    def cost(self) -> str:
        """What it costs, in words."""
        held = "; the logs hold it already" if self.is_held else ""
        return f"{self.candidate.robot_s:.0f} s of robot time; needs {self.candidate.needs}; loads {self.loads}{held}"


class Menu(NamedTuple):
    """All that was weighed, the most telling first; the best of what is worth running has passed the gate."""

    best: Recording | None
    recordings: tuple[Recording, ...]
    nothing: str = ""
    """Why nothing is worth running; empty where something is."""


def weighed(found: Diagnosed, seed: int, tell: Callable[[float], None], own: Motion | None = None) -> Menu:
    """Weigh the menu, or a user's ``own`` recording; ``seed`` is of all draws, ``tell`` gets the share that is done."""
    doubts = doubts_of(found.verdict, found.library)
    if not doubts and own is None:
        return Menu(None, (), _settled(found.verdict) + _split(found.verdict))
    kinds = menu_of(found, doubts) if own is None else (given(own),)
    board, made, best = board_of(found, found.runs), [], None
    for number, candidate in enumerate(kinds, start=1):
        made.append(weighed_one(candidate, found, doubts, board, seed))
        tell(0.7 * number / len(kinds))
    made.sort(key=lambda r: (bool(r.refused), not r.is_worth, -r.gain))
    for at, one in enumerate(made):
        if best is None and one.is_worth:
            made[at] = through_gate(one, found, board, seed)
            best = None if made[at].refused else made[at]
    tell(1.0)
    return Menu(best, tuple(made), "" if best is not None else _little(made) + _split(found.verdict))


def menu_of(found: Diagnosed, doubts: Sequence[Doubt]) -> tuple[Candidate, ...]:
    """The menu for what is in doubt: joints of the narrowest place are swept first."""
    places = [d.joints for d in found.verdict.differences]
    places += [tuple(j for j in JOINT_NAMES if j.endswith(d.key[2])) for d in doubts if d.key[2]]
    joints = [joint for place in sorted(places, key=len) for joint in place] or JOINT_NAMES
    effects = {t.effect for p in found.posterior.possibilities for t in p.terms}
    contract = None if found.policy is None else found.policy.contract
    return candidates(contract, [*dict.fromkeys(joints)], effects)


def board_of(found: Diagnosed, runs: Sequence[Run]) -> Evidence:
    """Runs laid out as a diagnosis does it."""
    with one_thread():
        return evidence_of(runs, found.nominal, found.policy, found.library)[-1]


def weighed_one(
    candidate: Candidate, found: Diagnosed, doubts: tuple[Doubt, ...], board: Evidence, seed: int
) -> Recording:
    """What one recording leaves in doubt, from a run of the corrected model beside the logs, which ``board`` is of."""
    after = {d.key: d.now for d in doubts}
    try:
        (run,) = _tried(candidate, found.robots[:1], found, seed)
    except BadInputError as error:
        return Recording(candidate, doubts, after, refused=(str(error),))
    held = is_held(run, found.runs)
    refused = () if held else refusals([run])
    loads = burden([run])
    if doubts and not refused:
        if not any(np.isfinite(log.states.load_nm).any() for log in found.runs):
            # The next log will have no loads either.
            run = replace(run, states=replace(run.states, load_nm=np.full_like(run.states.load_nm, np.nan)))
        before, then = (scatter_of(found, b) for b in (board, board_of(found, (*found.runs, run))))
        after |= {d.key: d.after(then[d.key] / before[d.key]) for d in doubts if d.key in then and before.get(d.key)}
    return Recording(candidate, tuple(sorted(doubts, key=lambda d: after[d.key] / d.now)), after, loads, refused, held)


def scatter_of(found: Diagnosed, board: Evidence) -> Mapping[Key, float]:
    """By how much what a board tells of each number scatters."""
    with one_thread():
        return known(board, found.verdict, found.posterior, found.nominal, found.library)


def through_gate(one: Recording, found: Diagnosed, board: Evidence, seed: int) -> Recording:
    """The recording, refused if one of the robots with wide errors does not bear it, unless the logs hold it."""
    if one.is_held:
        return one
    runs = _tried(one.candidate, wide_robots(found.robots, board, np.random.default_rng(seed)), found, seed)
    return one._replace(refused=refusals(runs), loads=burden(runs))


def _tried(candidate: Candidate, models: Sequence[RobotModel], found: Diagnosed, seed: int) -> tuple[Run, ...]:
    return try_on(candidate.motion, models, found.policy, seed, 1.0 / tick_period_s(found.runs))


def _little(made: Sequence[Recording]) -> str:
    """Why nothing that was weighed is worth running."""
    refused = [f"{r.candidate.name} is refused: {r.refused[0]}" for r in made if r.refused]
    safe = [r for r in made if r.doubts and not r.refused]
    if safe:
        best = max(safe, key=lambda r: max(r.drops))
        least = f"{words.percent(WORTH)} less is the least that is worth a recording"
        refused.insert(0, f"most is expected of {best.candidate.name}. {words.sentence(best.told[0])} {least}")
    return words.sentence("; ".join(refused))


def _settled(verdict: Verdict) -> str:
    """Why nothing is in doubt that a recording could narrow."""
    if verdict.status == "cannot_tell":
        return " ".join(["These logs show too little to weigh a recording.", *verdict.log_advice[:1]])
    if verdict.probability_unknown > NAMED:
        told = f"With {words.percent(verdict.probability_unknown)} an effect is there that the library lacks"
        return f"{told}: it has no formula by which a recording could be weighed. Look at the robot."
    return "No number is in doubt: what is left of the intervals is what formulas are usually wrong by."


def _split(verdict: Verdict) -> str:
    """What tells the members of a group apart, which no number says."""
    told = [f" To tell apart {words.called(d)}: {d.split.text}" for d in verdict.differences if d.split is not None]
    return "".join(told)
