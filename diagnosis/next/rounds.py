"""Ask the robot until one cause is left: design, run, diagnose all logs again; the story is kept in a file."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from math import log2
from pathlib import Path
from typing import Final

from diagnosis.next.design import Design, Proposal, in_words
from diagnosis.next.files import free_folder
from diagnosis.next.robots import LIKELY, all_beliefs
from diagnosis.verdict.posterior_file import Posterior
from spot_log import read_run
from spot_model.errors import BadInputError, SpotRlError
from spot_model.process.child_process import module_command
from spot_model.process.signals import run_in_foreground

STOPPED: Final = "a person stopped it"
MOST_FAILURES: Final = 2
"""Experiments that leave no log, or end early, before a person has to look."""


@dataclass(frozen=True)
class RobotRun:
    """What came of a run."""

    log: Path | None
    robot_s: float
    """From the log's first state to its last."""
    outcome: str
    """:data:`WHOLE`, or why it ended early."""
    is_interrupted: bool = False


@dataclass(frozen=True)
class Lab:
    """What the rounds work with."""

    folder: Path
    """Where experiments, logs and diagnoses go, a folder a round."""
    choose: Callable[[Posterior, int, Sequence[str], float], Design]
    """Ranks experiments, by a seed, without those of some names, within some robot time in seconds."""
    confirm: Callable[[Proposal, Design], bool]
    """Asks a person whether an experiment may run."""
    run: Callable[[Proposal, Path], RobotRun]
    """Runs one on the robot; its files go into a folder."""
    diagnose: Callable[[Sequence[Path], Path], Answer]
    """Diagnoses the first logs with these ones into a folder."""
    open: Callable[[Path], Answer]
    say: Callable[[str], None]
    told: Callable[[Story], None]
    """Given the story after every step, to be written."""


@dataclass(frozen=True)
class Limits:
    """When to end at the latest; both count from the first round."""

    budget_s: float
    """Robot time."""
    rounds: int
    """Experiments."""


def ask_robot(story: Story, lab: Lab, limits: Limits, seed: int) -> Story:
    """Go on with a story until one cause stands above :data:`SURE`, nothing more can be learned, or time is up."""
    try:
        found = _caught_up(story, lab)
        while not story.ending:
            found = _round(story, found, lab, limits, seed)
    except KeyboardInterrupt:
        story.ending, story.is_interrupted = STOPPED, True
    lab.told(story)
    return story


def _caught_up(story: Story, lab: Lab) -> Answer:
    """The newest diagnosis; of a log that came when somebody stopped, it is made now."""
    if not story.rounds:
        return story.first
    made = [r.found for r in story.rounds if r.found]
    found = lab.open(Path(made[-1])) if made else story.first
    return _diagnosed(story, found, lab) if story.rounds[-1].log and not story.rounds[-1].found else found


def _round(story: Story, found: Answer, lab: Lab, limits: Limits, seed: int) -> Answer:
    """One experiment; or the reason why there is none more."""
    story.ending = _ending(found, story, limits)
    if story.ending:
        return found
    left_s = limits.budget_s - story.robot_s
    lab.say(f"choosing experiment {len(story.rounds) + 1}; {left_s:.0f} s of robot time are left")
    plan = lab.choose(found.posterior, seed + len(story.rounds), story.excluded, left_s)
    chosen = next((p for p in plan.worthwhile if p.robot_s <= left_s), None)
    if chosen is None and any(p.is_promising for p in plan.proposals):
        story.ending = f"the budget of {limits.budget_s:.0f} s of robot time is used up"
    elif chosen is None:
        story.ending = f"no experiment that is safe tells more: {_why(plan)}"
    if chosen is None:
        return found
    if not lab.confirm(chosen, plan):
        story.ending = f"a person declined {chosen.candidate.name}"
        return found
    place = free_folder(lab.folder, f"round_{len(story.rounds) + 1}")
    lab.say(f"running: {chosen.candidate.title}, {chosen.robot_s:.0f} s of robot time")
    ran = lab.run(chosen, place)
    odds = found.odds
    asked = Round(
        name=chosen.candidate.name,
        title=chosen.candidate.title,
        values=chosen.values,
        parts=chosen.decides(plan.causes, plan.weights),
        expected_bits=round(chosen.told.bits, 3),
        robot_s=round(ran.robot_s, 2),
        outcome=ran.outcome,
        folder=str(place),
        log="" if ran.log is None else str(ran.log),
        found="",
        before=odds,
        after=odds,
        status=found.status,
        sentence=found.sentence,
    )
    story.rounds.append(asked)
    lab.told(story)
    if ran.outcome != WHOLE:
        lab.say(f"{chosen.candidate.name} ended early: {ran.outcome}")
    if ran.log is not None:
        found = _diagnosed(story, found, lab)
    if ran.is_interrupted:
        story.ending, story.is_interrupted = STOPPED, True
    return found


def _diagnosed(story: Story, found: Answer, lab: Lab) -> Answer:
    """Diagnose all logs, with the newest round's; one that cannot be used is left out from then on."""
    newest = story.rounds[-1]
    try:
        found = lab.diagnose(story.logs, free_folder(Path(newest.folder), "found"))
    except SpotRlError as error:
        lab.say(f"the log cannot be used: {error}")
        story.rounds[-1] = replace(newest, log="", outcome=f"{newest.outcome}; the log cannot be used: {error}")
    else:
        story.rounds[-1] = replace(
            newest, found=str(found.folder), after=found.odds, status=found.status, sentence=found.sentence
        )
    lab.told(story)
    return found


def _why(plan: Design) -> str:
    """Why nothing of a plan is worthwhile."""
    safe = [p for p in plan.proposals if not p.refused]
    refused = [f"{p.candidate.name} is refused ({p.refused[0]})" for p in plan.proposals if p.refused]
    best = max((p.told.bits for p in safe), default=0.0)
    told = [f"the best of {len(safe)} tells {best:.2f} bits"] if safe else []
    return "; ".join([*told, *refused]) or "there is none left"


def _ending(found: Answer, story: Story, limits: Limits) -> str:
    cause, odds = found.top
    # The calibration alone is no answer where the verdict sees something unknown.
    if odds >= SURE and (cause != in_words(()) or found.status in ("no_gap", "calibration")):
        return f"{cause} has a probability of {odds:.2f}"
    if len(story.failed) >= MOST_FAILURES:
        return f"{len(story.failed)} experiments did not run to their end; see to the robot"
    return f"{limits.rounds} experiments were run" if len(story.rounds) >= limits.rounds else ""


def run_on_robot(words: Sequence[str], log_dir: Path) -> RobotRun:
    """Run an experiment until the robot rests; ``words`` are the arguments of ``spot-rl``."""
    before = set(log_dir.glob("*.mcap"))
    is_interrupted = run_in_foreground(module_command("spot_model", *words)).is_interrupted
    made = sorted(set(log_dir.glob("*.mcap")) - before)
    if not made:
        return RobotRun(None, 0.0, "it left no log", is_interrupted)
    try:
        run = read_run(made[-1])
    except SpotRlError as error:
        return RobotRun(None, 0.0, str(error), is_interrupted)
    return RobotRun(made[-1], run.duration_s, run.outcome, is_interrupted)


def is_here(robot: str) -> bool:
    """Whether an address is of this computer, where no real robot is.

    Raises:
        BadInputError: It is no address.
    """
    # Here: a ranking needs no connection, and no gRPC.
    from spot_runtime.hal.address import parse_address
    from spot_runtime.operator.listening import is_loopback, is_unix

    address = parse_address(robot)
    return is_loopback(address.host if is_unix(address.host) else f"{address.host}:{address.port}")


SCHEMA: Final = "spot-rl/next-story/1"
WHOLE: Final = "completed"
"""Outcome of a run that went to its end."""
SURE: Final = 0.95
"""A cause of this probability is the answer."""
STILL: Final = 0.05
"""An experiment that moves less probability told nothing."""
LEAST: Final = 0.01
"""No probability counts as less: what is below is not told by name."""
LACKING: Final = "an effect that the library lacks"
OTHERS: Final = "others"
SHOWN: Final = 6
"""Causes that are told by name, at most."""


@dataclass(frozen=True)
class Answer:
    """A diagnosis of all logs so far."""

    folder: Path
    posterior: Posterior
    status: str
    sentence: str

    @property
    def odds(self) -> dict[str, float]:
        """Probability of each cause, the likeliest first; at the end all that are hardly likely, together."""
        known = {in_words(c): (1.0 - self.posterior.unknown) * w for c, w in all_beliefs(self.posterior).items()}
        ranked = sorted({**known, LACKING: self.posterior.unknown}.items(), key=lambda item: -item[1])
        shown = [item for item in ranked[:SHOWN] if item[1] >= LIKELY]
        return {**dict(shown), OTHERS: 1.0 - sum(p for _, p in shown)}

    @property
    def top(self) -> tuple[str, float]:
        """The likeliest cause."""
        return next(iter(self.odds.items()))


@dataclass(frozen=True)
class Round:
    """One round: what was asked, what came, how the odds moved."""

    name: str
    title: str
    values: str
    """Its chosen numbers."""
    parts: str
    """Which causes it was to set apart."""
    expected_bits: float
    robot_s: float
    outcome: str
    folder: str
    log: str
    """Empty where there is none that can be used."""
    found: str
    """Folder of the diagnosis with this log; empty where there is none yet."""
    before: dict[str, float]
    after: dict[str, float]
    status: str
    sentence: str

    @property
    def moved(self) -> float:
        """Probability that went over from some causes to others."""
        names = {*self.before, *self.after}
        return 0.5 * sum(abs(self.after.get(n, 0.0) - self.before.get(n, 0.0)) for n in names)

    @property
    def came_bits(self) -> float:
        """What the run told: Σ q log₂(q/p) from the odds p before to those q after; its expectation was foretold."""
        pairs = [(q, max(self.before.get(name, 0.0), LEAST)) for name, q in self.after.items() if q > LEAST]
        return max(sum(q * log2(q / p) for q, p in pairs), 0.0)


@dataclass
class Story:
    """All rounds, and how they ended."""

    first: Answer
    rounds: list[Round] = field(default_factory=list)
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

    @property
    def logs(self) -> list[Path]:
        """Logs of all rounds that left one."""
        return [Path(r.log) for r in self.rounds if r.log]

    @property
    def failed(self) -> list[str]:
        """Experiments that did not run to their end."""
        return [r.name for r in self.rounds if r.outcome != WHOLE]

    @property
    def excluded(self) -> list[str]:
        """Experiments that are not asked again: those that failed, and those that told nothing."""
        return self.failed + [r.name for r in self.rounds if r.outcome == WHOLE and r.moved < STILL]

    def to_json(self) -> str:
        """The text of ``story.json``."""
        data = {
            "schema": SCHEMA,
            "first": {"odds": self.first.odds, "status": self.first.status},
            "rounds": [asdict(r) for r in self.rounds],
            "robot_s": round(self.robot_s, 2),
            "ending": self.ending,
        }
        return json.dumps(data, indent=1) + "\n"


def read_story(path: Path, first: Answer) -> Story:
    """The story so far, to go on from; an empty one where there is no file.

    Raises:
        BadInputError: The file is no story.
    """
    if not path.exists():
        return Story(first)
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if data["schema"] != SCHEMA:
            raise ValueError(f"schema is {data['schema']!r}, not {SCHEMA!r}")
        return Story(first, [Round(**r) for r in data["rounds"]])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadInputError(f"{path} is no story of 'spot-rl diagnose next --run': {error}; move it away") from error
