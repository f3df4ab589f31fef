"""One diagnosis from files to files: what it is made of, how far it is, and what it writes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
from pydantic import Field
from rich.console import Console

from diagnosis.closed_loop.simulation import rollouts_under
from diagnosis.library import LibraryEffect
from diagnosis.library.registry import chosen_library
from diagnosis.read import apart_by_gains, find_policy_file, read_logs
from diagnosis.read.robot_file import SPOT, load_robot
from diagnosis.read.signal_checks import robot_of
from diagnosis.report.headline import headline
from diagnosis.report.output import write_all
from diagnosis.selection.normal_equations import one_thread
from diagnosis.selection.robot_models import merged
from diagnosis.verdict.diagnose import Diagnosis, diagnose
from spot_model.console import progress
from spot_model.io.model_file import RobotModel, load_model
from spot_model.io.settings import Settings
from spot_model.io.whole import write_over
from spot_model.policy.policy import load_policy
from trainer.simulate.engine import IN_THIS_PROCESS, Place

INPUTS: Final = "inputs.json"
STAGES: Final = (
    ("reading logs", 0.01),
    ("building channels", 0.08),
    ("trying", 0.27),
    ("simulating the models", 0.44),
    ("weighing", 0.18),
    ("writing the report", 0.02),
)
"""How the first message of each stage begins, and its mean share of the time, over six short logs and six long ones."""
NO_MODEL: Final = (
    "no model file: only Spot can be simulated here; verdict.json has the numbers for a simulator of your own"
)


class Inputs(Settings):
    """The words of a ``spot-rl diagnose``, kept beside its result so that it can be repeated with more logs."""

    schema_name: Literal["spot-rl/diagnosis-inputs/1"] = Field(default="spot-rl/diagnosis-inputs/1", alias="schema")
    logs: tuple[str, ...]
    nominal: str
    policy: str | None = None
    add_effect: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    since: str = ""
    """Date of the diagnosis whose corrected model the nominal one is; empty for other models."""

    def absolute(self) -> Inputs:
        """The same with absolute paths; a nominal model that is no file (a built-in name) stays as it is."""
        own = {
            "logs": tuple(str(Path(path).absolute()) for path in self.logs),
            "nominal": str(Path(self.nominal).absolute()) if Path(self.nominal).exists() else self.nominal,
            "policy": None if self.policy is None else str(Path(self.policy).absolute()),
        }
        return self.model_copy(update=own)

    def save(self, folder: Path) -> None:
        """Write them into a diagnosis' folder, with absolute paths."""
        write_over(folder / INPUTS, self.absolute().model_dump_json(by_alias=True, indent=1) + "\n")


class Progress(progress.Progress):
    """Shows how far a diagnosis is. Calling it with a text says the text; the text of a stage begins that stage.

    It goes to ``console``, standard error by default; ``clock`` gives seconds, for the time left.
    """

    def __init__(self, console: Console | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        console = console or Console(stderr=True)
        super().__init__("diagnosis", console=console, clock=clock)
        self._has_lines = not console.is_terminal
        self._begin, self._end = 0.0, 0.0
        self.share = 0.0

    def __call__(self, text: str) -> None:
        """Say something."""
        before = 0.0
        for begin, share in STAGES:
            if text.startswith(begin):
                self._begin, self._end = before, before + share
                self.share = max(self.share, before)
                break
            before += share
        self._say(text, is_told=self._has_lines)

    def at(self, share: float) -> None:
        """Show that the present stage is this far, 0 to 1."""
        self.share = max(self.share, self._begin + share * (self._end - self._begin))
        self._say(self._text)

    def _say(self, text: str, *, is_told: bool = False) -> None:
        self.update(100 * self.share, text, ahead=100 * max(0.0, self._end - self.share), is_told=is_told)


def run_session(
    inputs: Inputs,
    out: Path,
    say: Progress,
    *,
    nominal: RobotModel | None = None,
    library: Mapping[str, LibraryEffect] | None = None,
    robot_file: Path | None = None,
    with_synthesis: bool = False,
    place: Place = IN_THIS_PROCESS,
    seed: int = 0,
) -> tuple[Diagnosis, dict[str, Path]]:
    """Read, prepare, diagnose and write.

    Args:
        inputs: What is diagnosed.
        out: Folder for the results.
        say: Where progress goes.
        nominal: The simulator's model; by default the inputs' name is loaded.
        library: Effects that are tried; by default those of the inputs.
        robot_file: Describes a robot other than Spot.
        with_synthesis: As a check, also diagnose the nominal simulator with the effects added.
        place: Where closed loops are computed.
        seed: Of all random draws.

    Returns:
        The diagnosis, and the files by key.

    Raises:
        SpotRlError: Something that was given is wrong; nothing is written then.
    """
    nominal = merged(nominal or load_model(inputs.nominal))
    library = library or chosen_library(inputs.add_effect, inputs.without)
    robot = load_robot(robot_file) if robot_file is not None else SPOT
    # Logs, and the policy that made them.
    say("reading logs")
    runs, notes = read_logs([Path(path) for path in inputs.logs], robot, say.at)
    file = find_policy_file(None if inputs.policy is None else Path(inputs.policy), runs)
    policy = None if file is None else load_policy(file)
    if policy is not None:
        runs, at_other_gains = apart_by_gains(runs, policy)
        notes = (*notes, *at_other_gains)
    for text in notes:
        say(f"note: {text}")
    with one_thread(), nullcontext() if policy is None else rollouts_under(policy, place) as engine:
        result = diagnose(
            runs,
            nominal,
            policy,
            np.random.default_rng(seed),
            say,
            say.at,
            library=library,
            with_synthesis=with_synthesis,
            nominal_name=inputs.nominal,
            limits_rad=robot.limits_rad,
            engine=engine,
        )
    told = {"notes": tuple(dict.fromkeys((*notes, *result.verdict.notes))), "since": inputs.since}
    verdict = result.verdict.model_copy(update=told | {"robot": robot_of(runs)})
    if robot is not SPOT:
        # The library's recordings are walks of Spot: what to do stays, the command that would make Spot do it goes.
        differences = tuple(d.model_copy(update={"split": None}) for d in verdict.differences)
        notes = (*verdict.notes, NO_MODEL)
        verdict = verdict.model_copy(update={"differences": differences, "no_model": NO_MODEL, "notes": notes})
    result = replace(result, verdict=verdict.model_copy(update={"headline": headline(verdict)}))
    say("writing the report")
    paths = write_all(result, out, library)
    if robot is SPOT:
        inputs.save(out)
    return result, paths
