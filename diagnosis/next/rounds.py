"""Ask the robot until one cause is left: design, run, diagnose all logs again, and so on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from diagnosis.next.choose.design import Design, Proposal, in_words
from diagnosis.next.files import free_folder
from diagnosis.next.story import SURE, WHOLE, Asked, Found, Story
from diagnosis.verdict.posterior_file import Posterior
from spot_log import read_run
from spot_model.errors import SpotRlError
from spot_model.io.child_process import module_command
from spot_model.io.signals import run_in_foreground

STOPPED: Final = "a person stopped it"
MOST_FAILURES: Final = 2
"""Experiments that leave no log, or end early, before a person has to look."""


@dataclass(frozen=True)
class Ran:
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
    run: Callable[[Proposal, Path], Ran]
    """Runs one on the robot; its files go into a folder."""
    diagnose: Callable[[Sequence[Path], Path], Found]
    """Diagnoses the first logs with these ones into a folder."""
    open: Callable[[Path], Found]
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


def _caught_up(story: Story, lab: Lab) -> Found:
    """The newest diagnosis; of a log that came when somebody stopped, it is made now."""
    if not story.rounds:
        return story.first
    made = [r.found for r in story.rounds if r.found]
    found = lab.open(Path(made[-1])) if made else story.first
    return _diagnosed(story, found, lab) if story.rounds[-1].log and not story.rounds[-1].found else found


def _round(story: Story, found: Found, lab: Lab, limits: Limits, seed: int) -> Found:
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
    asked = Asked(
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


def _diagnosed(story: Story, found: Found, lab: Lab) -> Found:
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


def _ending(found: Found, story: Story, limits: Limits) -> str:
    cause, odds = found.top
    # The calibration alone is no answer where the verdict sees something unknown.
    if odds >= SURE and (cause != in_words(()) or found.status in ("no_gap", "calibration")):
        return f"{cause} has a probability of {odds:.2f}"
    if len(story.failed) >= MOST_FAILURES:
        return f"{len(story.failed)} experiments did not run to their end; see to the robot"
    return f"{limits.rounds} experiments were run" if len(story.rounds) >= limits.rounds else ""


def run_on_robot(words: Sequence[str], log_dir: Path) -> Ran:
    """Run an experiment until the robot rests; ``words`` are the arguments of ``spot-rl``."""
    before = set(log_dir.glob("*.mcap"))
    is_interrupted = run_in_foreground(module_command("spot_model", *words)).is_interrupted
    made = sorted(set(log_dir.glob("*.mcap")) - before)
    if not made:
        return Ran(None, 0.0, "it left no log", is_interrupted)
    try:
        run = read_run(made[-1])
    except SpotRlError as error:
        return Ran(None, 0.0, str(error), is_interrupted)
    return Ran(made[-1], run.duration_s, run.outcome, is_interrupted)


def is_here(robot: str) -> bool:
    """Whether an address is of this computer, where no real robot is.

    Raises:
        BadInputError: It is no address.
    """
    # Here: a ranking needs no connection, and no gRPC.
    from spot_runtime.hal.connection.address import parse_address
    from spot_runtime.operator.listening import is_loopback, is_unix

    address = parse_address(robot)
    return is_loopback(address.host if is_unix(address.host) else f"{address.host}:{address.port}")
