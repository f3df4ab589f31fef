"""Ask the robot until one cause is left: design, run, diagnose all logs again, and so on."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Final

from diagnosis.next.choose.design import Design, Proposal, in_words
from diagnosis.next.choose.robots import beliefs
from diagnosis.next.robot_run import Ran
from diagnosis.verdict.posterior_file import Posterior
from spot_model.errors import SpotRlError

SURE: Final = 0.95
"""A cause of this probability is the answer."""
STOPPED: Final = "a person stopped it"
MOST_FAILURES: Final = 2
"""Experiments that leave no log, or end early, before a person has to look."""


@dataclass(frozen=True)
class Found:
    """A diagnosis of all logs so far."""

    folder: Path
    posterior: Posterior
    status: str
    sentence: str

    @property
    def odds(self) -> dict[str, float]:
        """Probability of each cause, the likeliest first."""
        return {in_words(c): w for c, w in beliefs(self.posterior).items()}

    @property
    def top(self) -> tuple[str, float]:
        """The likeliest cause."""
        return next(iter(self.odds.items()))


@dataclass(frozen=True)
class Asked:
    """One round: what was asked, what came, how the odds moved."""

    name: str
    title: str
    parts: str
    """Which causes it was to set apart."""
    expected_bits: float
    robot_s: float
    outcome: str
    log: str
    before: dict[str, float]
    after: dict[str, float]
    status: str
    sentence: str


@dataclass
class Story:
    """All rounds, and how they ended."""

    first: Found
    rounds: list[Asked] = field(default_factory=list)
    ending: str = ""
    is_interrupted: bool = False

    @property
    def robot_s(self) -> float:
        """Robot time used, s."""
        return sum(r.robot_s for r in self.rounds)

    @property
    def odds(self) -> dict[str, float]:
        """Probability of each cause by now, the likeliest first."""
        return self.rounds[-1].after if self.rounds else self.first.odds

    @property
    def sentence(self) -> str:
        """The newest diagnosis in a sentence."""
        return self.rounds[-1].sentence if self.rounds else self.first.sentence

    def to_json(self) -> str:
        """As text for ``story.json``."""
        data = {
            "schema": "spot-rl/next-story/1",
            "first": {"odds": self.first.odds, "status": self.first.status},
            "rounds": [asdict(r) for r in self.rounds],
            "robot_s": round(self.robot_s, 2),
            "ending": self.ending,
        }
        return json.dumps(data, indent=1) + "\n"


@dataclass(frozen=True)
class Lab:
    """What the rounds work with.

    Args:
        folder: Where experiments, logs and diagnoses go, a folder a round.
        choose: Ranks experiments, by a seed and without those of some names.
        confirm: Asks a person whether an experiment may run.
        run: Runs one on the robot; its files go into a folder.
        diagnose: Diagnoses the first logs with these ones into a folder.
        say: Where progress goes.
    """

    folder: Path
    choose: Callable[[Posterior, int, Sequence[str]], Design]
    confirm: Callable[[Proposal, Design], bool]
    run: Callable[[Proposal, Path], Ran]
    diagnose: Callable[[Sequence[Path], Path], Found]
    say: Callable[[str], None]


def ask_robot(
    first: Found, lab: Lab, *, budget_s: float, most_rounds: int, seed: int, told: Callable[[Story], None]
) -> Story:
    """Run experiments until one cause stands above :data:`SURE`, nothing more can be learned, or time is up.

    Args:
        first: The diagnosis of the first logs.
        lab: What to work with.
        budget_s: Robot time.
        most_rounds: Experiments, at most.
        seed: Of all draws.
        told: Given the story after every round, to be written.
    """
    story = Story(first)
    try:
        _ask(story, lab, budget_s, most_rounds, seed, told)
    except KeyboardInterrupt:
        story.ending, story.is_interrupted = STOPPED, True
    told(story)
    return story


def _ask(story: Story, lab: Lab, budget_s: float, most_rounds: int, seed: int, told: Callable[[Story], None]) -> None:
    found, failed, logs = story.first, list[str](), list[Path]()
    while not story.ending:
        story.ending = _ending(found, story, most_rounds)
        if story.ending:
            return
        left_s = budget_s - story.robot_s
        lab.say(f"choosing experiment {len(story.rounds) + 1}; {left_s:.0f} s of robot time are left")
        plan = lab.choose(found.posterior, seed + len(story.rounds), failed)
        if not plan.worthwhile:
            story.ending = "no experiment that is safe tells more"
            return
        chosen = next((p for p in plan.worthwhile if p.robot_s <= left_s), None)
        if chosen is None:
            story.ending = f"the budget of {budget_s:.0f} s of robot time is used up"
            return
        if not lab.confirm(chosen, plan):
            story.ending = f"a person declined {chosen.candidate.name}"
            return
        place = lab.folder / f"round_{len(story.rounds) + 1}"
        place.mkdir(parents=True)
        lab.say(f"running: {chosen.candidate.title}, {chosen.robot_s:.0f} s of robot time")
        ran = lab.run(chosen, place)
        if ran.log is None or not ran.is_whole:
            failed.append(chosen.candidate.name)
            lab.say(f"{chosen.candidate.name} ended early: {ran.outcome}")
        before = found.odds
        if ran.log is not None:
            logs.append(ran.log)
            try:
                found = lab.diagnose(logs, place / "found")
            except SpotRlError as error:
                logs.pop()
                lab.say(f"the log cannot be used: {error}")
        story.rounds.append(_asked(chosen, plan, ran, before, found))
        told(story)
        if ran.is_interrupted:
            story.ending, story.is_interrupted = STOPPED, True
        elif len(failed) >= MOST_FAILURES:
            story.ending = f"{len(failed)} experiments did not run to their end; see to the robot"


def _ending(found: Found, story: Story, most_rounds: int) -> str:
    cause, odds = found.top
    if odds >= SURE:
        return f"{cause} stands at {odds:.2f}"
    return f"{most_rounds} experiments were run" if len(story.rounds) >= most_rounds else ""


def _asked(chosen: Proposal, plan: Design, ran: Ran, before: dict[str, float], found: Found) -> Asked:
    return Asked(
        name=chosen.candidate.name,
        title=chosen.candidate.title,
        parts=chosen.decides(plan.causes, plan.weights),
        expected_bits=round(chosen.told.bits, 3),
        robot_s=round(ran.robot_s, 2),
        outcome=ran.outcome,
        log="" if ran.log is None else str(ran.log),
        before=before,
        after=found.odds,
        status=found.status,
        sentence=found.sentence,
    )
