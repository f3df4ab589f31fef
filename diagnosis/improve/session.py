"""An improvement from logs to page: the steps in order, each done once."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import yaml
from pydantic import Field, ValidationError
from typing_extensions import Self

from diagnosis.document import Verdict
from diagnosis.improve.improvement import Improvement, TakenStep, outcome_of, step_names, worth_training
from diagnosis.improve.judgement import compared_figures
from diagnosis.improve.limits import Limit, is_nearer, limits_of, search_config, with_limits
from diagnosis.improve.page import improvement_page
from diagnosis.improve.retraining import RETRAIN, refine_config, take_training, train_words
from diagnosis.improve.steps import CommandStep, Say, take
from spot_model.errors import BadInputError
from spot_model.io.model_file import load_model
from spot_model.io.models_file import load_models, save_models
from spot_model.io.settings import Settings, explain
from spot_model.io.whole import whole_file, write_new, write_over
from spot_model.policy.policy import load_policy
from spot_model.version import software_revision
from trainer.config.train_config import load_train_config
from trainer.sysid.result import ResultData

ROBOTS_DRAWN: Final = 1
"""Added to the seed for the draws of limits."""


class ImproveRequest(Settings):
    """What is asked for, kept beside the result so that a second call goes on with the same."""

    schema_name: Literal["spot-rl/improvement-inputs/1"] = Field(default="spot-rl/improvement-inputs/1", alias="schema")
    logs: tuple[str, ...]
    policy: str
    policy_sha256: str
    nominal: str
    config: str
    sets: tuple[str, ...]
    n: int
    seed: int

    @classmethod
    def of(
        cls,
        logs: Sequence[Path],
        policy: Path,
        nominal: str,
        config: Path | None,
        sets: tuple[str, ...],
        n: int,
        seed: int,
    ) -> Self:
        """Check all that can be checked before any work. Raises SpotRlError: a file is missing or not valid."""
        for path in logs:
            if not path.exists():
                raise BadInputError(f"there is no log {path}; give files of spot-rl (*.mcap), or folders of them")
        load_model(nominal)
        load_train_config(config or RETRAIN, sets)
        return cls(
            logs=tuple(str(path.absolute()) for path in logs),
            policy=str(policy.absolute()),
            policy_sha256=load_policy(policy).sha256,
            nominal=str(Path(nominal).absolute()) if Path(nominal).is_file() else nominal,
            config=str((config or RETRAIN).absolute()),
            sets=sets,
            n=n,
            seed=seed,
        )


@dataclass
class _Steps:
    """Steps with where their results go, and those that were taken."""

    place: dict[str, Path]
    device: str
    say: Say
    taken: list[TakenStep] = field(default_factory=list)

    def take(
        self, about: str, words: tuple[str, ...], result: str, *, cores: tuple[str, ...] = (), on_gpu: bool = True
    ) -> None:
        """Run the words unless the result is there, with further words on the cores."""
        step = CommandStep(about, (*words, *cores), self.place[result])
        if on_gpu and self.device != "cpu":
            step = CommandStep(about, (*words, "--device", self.device), step.result, on_cores=step.words)
        self.done(step, take(step, self.say))

    def done(self, step: CommandStep, seconds: float | None) -> None:
        """Keep a step that was taken."""
        self.taken.append(TakenStep(step.about, step.command, seconds))


def improve_policy(
    inputs: ImproveRequest, out: Path, *, workers: int, device: str, say: Say
) -> tuple[Improvement, Path]:
    """Take every step that is left; returns the outcome and its page.

    Raises:
        BadInputError: ``out`` holds another improvement.
        SpotRlError: A step failed.
        KeyboardInterrupt: The user stopped a step; the next call goes on.
    """
    out = out.absolute()
    place, policy = step_names(out), Path(inputs.policy)
    _keep(inputs, place["inputs"])
    steps = _Steps(place, device, say)
    # What the logs say of the robot; on the cores, where a GPU would not be quicker.
    words = ("diagnose", *inputs.logs, "--nominal", inputs.nominal, "--policy", inputs.policy,
             "--out", str(place["verdict"].parent), "--seed", str(inputs.seed), "--workers", str(workers))  # fmt: skip
    steps.take("diagnosis", words, "verdict", on_gpu=False)
    verdict = Verdict.model_validate_json(place["verdict"].read_bytes())
    limits, said = _identify(inputs, steps, workers)
    why = worth_training(verdict, limits)
    evaluations: list[dict[str, Any]] = []
    if why is None:
        # The robots that the logs allow, and the policy trained on them.
        if not place["robots"].exists():
            rng = np.random.default_rng(inputs.seed + ROBOTS_DRAWN)
            save_models(with_limits(load_models(str(place["possible"])), limits, rng), place["robots"])
        if device == "cpu":
            _refine(inputs, steps, workers)
        else:
            _train(inputs, steps)
        # A search over gains that found nothing better wrote no policy.
        both = (("old", policy), ("new", place["retrained"])) if place["retrained"].exists() else ()
        for name, path in both:
            words = ("evaluate", str(path), "--model", str(place["robots"]), "--n", str(inputs.n),
                     "--seed", str(inputs.seed), "--out", str(place[name].parent))  # fmt: skip
            steps.take(f"evaluation of the {name} policy", words, name)
            evaluations.append(json.loads(place[name].read_text(encoding="utf-8")))
    compared = compared_figures(*evaluations) if evaluations else ()
    outcome = why or outcome_of(compared)
    config = {**inputs.model_dump(by_alias=True), "device": device, "revision": software_revision()}
    result = Improvement(outcome, policy.stem, limits, compared, tuple(steps.taken), (*verdict.warnings, *said), config)
    if outcome == "improved" and not place["improved"].exists():
        with whole_file(place["improved"]) as part:
            shutil.copyfile(place["retrained"], part)
    # Both follow from what the steps left, so a second call may write them anew.
    write_over(place["data"], json.dumps(result.to_data(), indent=1) + "\n")
    write_over(place["page"], improvement_page(result, verdict, evaluations))
    return result, place["page"]


def _keep(inputs: ImproveRequest, path: Path) -> None:
    """Write the inputs, or see that they are those of the improvement that is there."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_new(path, inputs.model_dump_json(by_alias=True, indent=1) + "\n")
        return
    try:
        before = ImproveRequest.model_validate_json(path.read_bytes())
    except ValidationError as error:
        raise BadInputError(f"{path}:\n{explain(error)}") from error
    other = [key for key, value in inputs if value != getattr(before, key)]
    if other:
        raise BadInputError(
            f"{path.parent} holds an improvement with another {other[0]} ({getattr(before, other[0])}); give that "
            "again to go on, or name another folder with --out"
        )


def _identify(inputs: ImproveRequest, steps: _Steps, workers: int) -> tuple[tuple[Limit, ...], tuple[str, ...]]:
    """What the paper's search finds of the knees' limits, and what is to be said of it."""
    place = steps.place
    data = search_config(load_model(str(place["corrected"])), str(place["corrected"]), steps.device, inputs.seed)
    if data is None:
        return (), ("The model has no single curve of torque over speed, so no limits were identified.",)
    if not place["search"].exists():
        write_new(place["search"], yaml.safe_dump(data, sort_keys=False))
    folder = place["identified"].parent
    words = ("sysid", *inputs.logs, "--policy", inputs.policy, "--config", str(place["search"]), "--out", str(folder))
    resumed = ("--resume",) if (folder / "search.jsonl").exists() else ()
    steps.take("identification of limits", (*words, *resumed), "identified", cores=("--workers", str(workers)))
    found = ResultData.model_validate_json(place["identified"].read_bytes())
    if is_nearer(found):
        return limits_of(found, load_model(inputs.nominal)), ()
    return (), (
        "The limits that were identified are left out: with them, simulated runs are no nearer to the robot's.",
    )


def _train(inputs: ImproveRequest, steps: _Steps) -> None:
    """PPO on a GPU, from where the policy stands."""
    place, device = steps.place, steps.device
    policy, run = Path(inputs.policy), place["training"]
    contract, config = load_policy(policy).contract, load_train_config(Path(inputs.config), inputs.sets)
    words = train_words(place["robots"], policy, contract, Path(inputs.config), inputs.sets, run, device)
    last = run / f"checkpoint_{config.iterations:06d}.pt"
    step = CommandStep("training", words, last)
    steps.done(step, take_training(step, run, config.n_envs, device, steps.say))
    steps.take("export", ("export", str(run), "--out", str(place["retrained"])), "retrained", on_gpu=False)


def _refine(inputs: ImproveRequest, steps: _Steps, workers: int) -> None:
    """A search over gains on the cores."""
    place = steps.place
    if not place["refine"].exists():
        contract = load_policy(Path(inputs.policy)).contract
        data = refine_config(place["robots"], contract, inputs.seed)
        write_new(place["refine"], yaml.safe_dump(data, sort_keys=False))
    words = ("refine", inputs.policy, "--config", str(place["refine"]), "--folder", str(place["refined"].parent),
             "--out", str(place["retrained"]), "--jobs", str(workers))  # fmt: skip
    steps.take("refinement of gains", words, "refined", on_gpu=False)
