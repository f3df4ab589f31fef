"""One ``spot-rl diagnose next``: from a diagnosis' folder to a ranking, or to rounds on a robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import ValidationError
from rich.console import Console

from diagnosis.closed_loop.run_numbers import HELD_S
from diagnosis.document import load_verdict
from diagnosis.library.registry import chosen_library
from diagnosis.next.candidates import Motion, given
from diagnosis.next.design import Design, Proposal, design
from diagnosis.next.files import free_folder, ranking_lines, run_words, save_motion, write_offers
from diagnosis.next.page import ranking_page, story_page
from diagnosis.next.prediction import (
    Prediction,
    check_log,
    check_prediction,
    digest_of,
    load_prediction,
    predict,
    with_log,
)
from diagnosis.next.rounds import Answer, Lab, Limits, RobotRun, Story, ask_robot, read_story, run_on_robot
from diagnosis.read import find_policy_file, read_logs
from diagnosis.report.output import NAMES
from diagnosis.session import Inputs, Progress, load_inputs, run_session
from diagnosis.verdict.posterior_file import Posterior, load_posterior
from spot_log import read_run
from spot_model.console.progress import Progress as Bar
from spot_model.errors import BadInputError
from spot_model.io.settings import explain
from spot_model.io.velocity_sequence import load_sequence
from spot_model.io.whole import check_new, whole_folder, write_new, write_over
from spot_model.policy.policy import Policy, load_policy


@dataclass
class Session:
    """A diagnosis with what it was made of, and where more goes."""

    folder: Path
    inputs: Inputs
    found: Answer
    policy: Policy | None
    seed: int
    own: Motion | None = None
    """A user's own experiment, in the place of all that could be chosen."""
    page: Path | None = None

    @classmethod
    def opened(cls, folder: Path, logs: Sequence[Path], nominal: str | None, policy: Path | None, seed: int) -> Session:
        """Open a diagnosis; make it first where logs are given.

        Raises:
            BadInputError: There is none, or it is of a robot that cannot be simulated.
        """
        if logs:
            if nominal is None:
                raise BadInputError("--logs needs the simulator's model; give --nominal MODEL")
            own_policy = None if policy is None else str(policy)
            given = Inputs(logs=tuple(map(str, logs)), nominal=nominal, policy=own_policy).absolute()
            if not (folder / NAMES["verdict"]).exists():
                diagnosed(given, (), folder)
            elif load_inputs(folder).model_copy(update={"policy": given.policy}) != given:
                raise BadInputError(
                    f"{folder} holds a diagnosis of other logs or another model; leave --logs out to use it, or "
                    "choose another folder"
                )
        inputs = load_inputs(folder)
        if policy is not None:
            inputs = inputs.model_copy(update={"policy": str(policy.absolute())})
        elif inputs.policy is None:
            runs, _ = read_logs([Path(p) for p in inputs.logs])
            file = find_policy_file(None, runs)
            inputs = inputs.model_copy(update={"policy": None if file is None else str(file.absolute())})
        loaded = None if inputs.policy is None else load_policy(Path(inputs.policy))
        return cls(folder, inputs, found_in(folder), loaded, seed)

    def rank(self) -> list[str]:
        """Rank experiments, write them, and say so."""
        plan = self._chosen(self.found.posterior, self.seed, wanted=None)
        place = free_folder(self.folder, "next")
        with whole_folder(place) as part:
            commands = write_offers(plan, part, place, self.inputs.policy)
            (part / "next.html").write_text(ranking_page(plan, commands), encoding="utf-8")
        self.page = place / "next.html"
        return [*ranking_lines(plan, commands), "", f"page: {self.page}"]

    def ask(self, robot_words: Sequence[str], confirm: Callable[[Proposal, list[str]], bool], limits: Limits) -> Story:
        """Run experiments on a robot; logs, diagnoses and the story stay in ``asked``, where a later start goes on."""
        place = self.folder / "asked"
        place.mkdir(exist_ok=True)
        self.page = page = place / "story.html"

        def agreed(proposal: Proposal, plan: Design) -> bool:
            return confirm(proposal, ranking_lines(replace(plan, proposals=(proposal,)), {}))

        def told(story: Story) -> None:
            for path, text in ((page, story_page(story)), (place / "story.json", story.to_json())):
                write_over(path, text)

        def run(chosen: Proposal, round_folder: Path) -> RobotRun:
            file, logs = round_folder / f"{chosen.candidate.name}.yaml", round_folder / "logs"
            logs.mkdir()
            save_motion(chosen.motion, file)
            words = run_words(chosen.motion, file, self.inputs.policy, str(logs))
            return run_on_robot([*words, *robot_words], logs)

        lab = Lab(
            folder=place,
            choose=self._chosen,
            confirm=agreed,
            run=run,
            diagnose=lambda logs, out: diagnosed(self.inputs, logs, out),
            open=found_in,
            say=lambda text: Console(stderr=True).print(text, markup=False, highlight=False),
            told=told,
        )
        story = read_story(place / "story.json", self.found)
        if self.own is not None:
            limits = replace(limits, rounds=min(limits.rounds, len(story.rounds) + 1))
        return ask_robot(story, lab, limits, self.seed)

    def _chosen(
        self,
        posterior: Posterior,
        seed: int,
        excluded: Sequence[str] = (),
        most_s: float = float("inf"),
        wanted: int | None = 1,
    ) -> Design:
        with Bar("choosing") as bar:

            def tell(share: float) -> None:
                bar.update(round(100 * share), "trying experiments on simulated robots")

            tell(0.0)
            return design(
                posterior, self.policy, seed, tell, excluded=excluded, own=self.own, wanted=wanted, most_s=most_s
            )

    def predicted(self, sequence: str, log: Path | None, out: Path | None) -> list[str]:
        """Predict a run, or compare a prediction with the log of the run; see :meth:`prediction`."""
        made, path, is_new, damage = self.prediction(sequence, log, out)
        if log is not None:
            return [*made.lines(), *(f"  log {log}: {text}" for text in damage)]
        where = f"written to {path}" if is_new else f"{path} was there: this is what was predicted then"
        return [*made.lines(), f"{where}; after the run give --log LOG"]

    def prediction(
        self, sequence: str, log: Path | None, out: Path | None
    ) -> tuple[Prediction, Path, bool, tuple[str, ...]]:
        """Predict a run, or compare a prediction with the log of the run.

        Returns:
            The prediction, its file, whether the file is new, and what could not be read of the log.

        Raises:
            BadInputError: There is no policy, the command is beyond its range, the prediction that is there is of
                something else, or the log is of no whole run of that command that began after it.
        """
        if self.policy is None:
            raise BadInputError("a walk needs its policy; give --policy FILE.onnx")
        wanted = load_sequence(sequence)
        path = out or self.folder / f"prediction_{given(wanted).name}.json"
        posterior, is_new = self.found.posterior, not path.exists()
        if not is_new:
            made = load_prediction(path)
            check_prediction(made, path, wanted, self.policy, digest_of(posterior))
        elif log is not None:
            raise BadInputError(
                f"{path} is not there: a run can only be compared with a prediction that was made before it"
            )
        else:
            clipped = wanted.clipped(np.array(self.policy.command_low), np.array(self.policy.command_high))
            if clipped != wanted:
                raise BadInputError(
                    f"sequence {wanted.name} asks for more than policy {self.policy.contract.name} was trained on, "
                    f"{self.policy.command_low} to {self.policy.command_high} (m/s, m/s, rad/s); ask for less"
                )
            if wanted.duration_s < HELD_S:
                raise BadInputError(
                    f"sequence {wanted.name}: duration_s is {wanted.duration_s:g}; allowed: at least {HELD_S:g} s, for "
                    "which a top speed is held"
                )
            check_new(path)
            library = chosen_library(list(self.inputs.add_effect), list(self.inputs.without))
            runs, _ = read_logs([Path(p) for p in self.inputs.logs])
            made = predict(posterior, dict(library), wanted, self.policy, runs, self.seed)
            write_new(path, made.to_json())
        if log is None:
            return made, path, is_new, ()
        run = read_run(log)
        check_log(made, run, self.policy)
        return with_log(made, run), path, is_new, run.damage


def diagnosed(inputs: Inputs, more_logs: Sequence[Path], out: Path) -> Answer:
    """Diagnose the logs and more of them into a folder.

    Raises:
        SpotRlError: Something that was given is wrong.
    """
    everything = inputs.model_copy(update={"logs": (*inputs.logs, *(str(path.absolute()) for path in more_logs))})
    with Progress() as progress:
        run_session(everything, out, progress)
    return found_in(out)


def found_in(folder: Path) -> Answer:
    """The diagnosis in a folder.

    Raises:
        BadInputError: The folder holds none, or one of another robot than Spot, or of another release.
    """
    if not (folder / NAMES["verdict"]).exists():
        raise BadInputError(f"{folder} holds no verdict.json; diagnose logs into it, or give --logs and --nominal")
    if not (folder / NAMES["posterior"]).exists():
        raise BadInputError(f"{folder} holds no {NAMES['posterior']}: nothing but Spot can be simulated")
    try:
        verdict, posterior = load_verdict(folder / NAMES["verdict"]), load_posterior(folder / NAMES["posterior"])
    except ValidationError as error:
        raise BadInputError(
            f"{folder}: a diagnosis of another release, or damaged; diagnose again:\n{explain(error)}"
        ) from error
    return Answer(folder, posterior, verdict.status, verdict.headline)
