"""One diagnosis from files to files: what it is made of, how far it is, and what it writes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
from pydantic import Field
from rich.console import Console

from diagnosis.closed_loop.simulation import rollouts_under
from diagnosis.document import Verdict
from diagnosis.library import LibraryEffect
from diagnosis.library.registry import chosen_library
from diagnosis.read import apart_by_gains, find_policy_file, fixed_base, read_logs
from diagnosis.read.prepare import drives_of
from diagnosis.read.robot_file import SPOT, RobotFile, load_robot
from diagnosis.read.signal_checks import robot_of
from diagnosis.report.headline import headline
from diagnosis.report.output import write_all
from diagnosis.selection.normal_equations import one_thread
from diagnosis.selection.robot_models import effects_merged
from diagnosis.verdict.diagnose import Diagnosis, diagnose_runs
from spot_log.read.run import Run
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
    f"no closed loops: only Spot is simulated with a policy; {fixed_base.ROBOT_FILE} has the numbers for a simulator "
    "of your own"
)
EFFECTS: Final = ("armature", "coulomb_friction", "viscous_friction", "torque_offset")
"""Whose numbers, joint by joint, are those of another robot's drives."""

WITHOUT_ARM: Final = (
    "the robot has an arm, and the nominal model has none, so that its weight shows as a payload; give --nominal "
    "spot_with_arm, or a model file with 'robot: spot_with_arm'"
)


class DiagnosisRequest(Settings):
    """The words of a ``spot-rl diagnose``, kept beside its result so that it can be repeated with more logs."""

    schema_name: Literal["spot-rl/diagnosis-inputs/1"] = Field(default="spot-rl/diagnosis-inputs/1", alias="schema")
    logs: tuple[str, ...]
    nominal: str
    policy: str | None = None
    add_effect: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    since: str = ""
    """Date of the diagnosis whose corrected model the nominal one is; empty for other models."""

    def absolute(self) -> DiagnosisRequest:
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


class DiagnosisProgress(progress.Progress):
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
    inputs: DiagnosisRequest,
    out: Path,
    say: DiagnosisProgress,
    *,
    nominal: RobotModel | None = None,
    library: Mapping[str, LibraryEffect] | None = None,
    check_robot: Callable[[str], None] = lambda _: None,
    robot_file: Path | None = None,
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
        check_robot: Told the logs' robot before anything is computed; raises where they must not be of that one.
        robot_file: Describes a robot other than Spot.
        place: Where closed loops are computed.
        seed: Of all random draws.

    Returns:
        The diagnosis, and the files by key.

    Raises:
        SpotRlError: Something that was given is wrong; nothing is written then.
    """
    nominal = effects_merged(nominal or load_model(inputs.nominal))
    library = library or chosen_library(inputs.add_effect, inputs.without)
    robot = load_robot(robot_file) if robot_file is not None else SPOT
    # Logs, and the policy that made them.
    say("reading logs")
    runs, notes = read_logs([Path(path) for path in inputs.logs], robot, say.at)
    check_robot(robot_of(runs))
    file = find_policy_file(None if inputs.policy is None else Path(inputs.policy), runs)
    policy = None if file is None else load_policy(file)
    if policy is not None:
        runs, at_other_gains = apart_by_gains(runs, policy)
        notes = (*notes, *at_other_gains)
    if nominal.robot == "spot" and any(len(run.arm) for run in runs):
        notes = (*notes, WITHOUT_ARM)
    for text in notes:
        say(f"note: {text}")
    with one_thread(), nullcontext() if policy is None else rollouts_under(policy, place) as engine:
        result = diagnose_runs(
            runs,
            nominal,
            policy,
            np.random.default_rng(seed),
            say,
            say.at,
            library=library,
            nominal_name=inputs.nominal,
            robot=robot,
            engine=engine,
        )
    told = {"notes": tuple(dict.fromkeys((*notes, *result.verdict.notes))), "since": inputs.since}
    verdict = result.verdict.model_copy(update=told | {"robot": robot_of(runs)})
    files: Mapping[str, str] = {}
    if robot is not SPOT:
        # The library's recordings are walks of Spot: what to do stays, the command that would make Spot do it goes.
        differences = tuple(d.model_copy(update={"split": None}) for d in verdict.differences)
        drives = _drives(verdict, runs, robot)
        files = fixed_base.corrected_files(robot, drives)
        notes = (*verdict.notes, *_fit_sentences(robot, runs, drives), NO_MODEL)
        verdict = verdict.model_copy(update={"differences": differences, "no_model": NO_MODEL, "notes": notes})
    result = replace(result, verdict=verdict.model_copy(update={"headline": headline(verdict)}))
    say("writing the report")
    paths = write_all(result, out, library, files)
    if robot is SPOT:
        inputs.save(out)
    return result, paths


def _drives(verdict: Verdict, runs: Sequence[Run], robot: RobotFile) -> fixed_base.Drives:
    """Another robot's drives: by least squares where loads are computed, else by the verdict.

    Their delay is what was taken off the logs' commands.
    """
    late_ns = np.concatenate([run.commands.robot_stamp_ns - run.commands.host_stamp_ns for run in runs])
    delay_s = float(np.median(late_ns)) * 1e-9 if late_ns.size else 0.0
    each = [drives_of(run)[0] for run in runs if robot.is_from_motion and np.isfinite(run.states.load_nm).all()]
    if each:
        found = {name: np.mean([getattr(own, name) for own in each], axis=0) for name in fixed_base.EACH}
    else:
        told = {(n.effect, n.where): n.value for n in verdict.calibration.units}
        found = {
            name: np.array([told.get((effect, joint), 0.0) for joint in robot.joint_names])
            for name, effect in zip(fixed_base.EACH, EFFECTS, strict=True)
        }
    return fixed_base.Drives(**found, delay_s=delay_s)


def _fit_sentences(robot: RobotFile, runs: Sequence[Run], drives: fixed_base.Drives) -> tuple[str, ...]:
    """How near simulations of the rigid bodies come to the logs without drives and with them, in a sentence."""
    if robot.mjcf is None or not any(np.isfinite(run.commands.kp_nm_per_rad).any() for run in runs):
        return ()
    # The logs' commands are late already.
    models = (fixed_base.Drives.of(robot.model_copy(update={"drive": None})), replace(drives, delay_s=0.0))
    before, after = (
        1e3 * float(np.mean([fixed_base.error_rad(robot, run, model) for run in runs])) for model in models
    )
    if not after < 1e3 * np.pi:
        return (
            "simulated under the logs' commands, the MJCF's joints turn away from the logs': it predicts no motion",
        )
    told = f"simulated under the logs' commands for {fixed_base.RESTART_S:.0f} s at a time, the MJCF's joints are"
    return (f"{told} {before:.3g} mrad off, and {after:.3g} mrad with the drives of {fixed_base.ROBOT_FILE}",)
