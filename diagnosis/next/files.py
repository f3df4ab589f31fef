"""From a diagnosis' folder to a menu and its files: the recording with its commands, all that was weighed, the page."""

from __future__ import annotations

import json
from itertools import count
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from diagnosis.document import load_verdict
from diagnosis.library.registry import chosen_library
from diagnosis.library.repairs import with_repairs
from diagnosis.next.candidates import Motion
from diagnosis.next.menu import Diagnosed, Menu, weighed
from diagnosis.next.page import menu_page
from diagnosis.read import apart_by_gains, find_policy_file, read_logs
from diagnosis.report.output import NAMES
from diagnosis.selection.robot_models import merged
from diagnosis.session import Inputs, load_inputs
from diagnosis.verdict.posterior_file import load_posterior
from spot_model.console.progress import Progress
from spot_model.errors import BadInputError
from spot_model.io.joint_experiment import SCHEMA, joint_experiment_from_data, save_joint_experiment
from spot_model.io.model_file import load_model
from spot_model.io.models_file import load_models
from spot_model.io.settings import explain
from spot_model.io.velocity_sequence import VelocitySequence, load_sequence, save_sequence
from spot_model.io.whole import whole_folder
from spot_model.io.yaml_text import read_yaml
from spot_model.policy.policy import load_policy

LASTS_S: Final = (4.0, 60.0)
"""Length of a walk that is weighed, s: it is simulated on some fifty robots."""


def propose(
    folder: Path, policy: Path | None = None, *, own: Motion | None = None, out: Path | None = None, seed: int = 0
) -> tuple[list[str], Path]:
    """Weigh the menu, or a user's ``own`` recording, and write it; returns lines for a terminal, and the page.

    Raises:
        BadInputError: The folder holds no diagnosis of Spot.
        OutputExistsError: ``out`` holds a menu already.
    """
    inputs, found = opened(folder, policy)
    with Progress("weighing") as bar:
        menu = weighed(found, seed, lambda share: bar.update(round(100 * share), "simulating recordings"), own)
    names = ("next" if n == 1 else f"next-{n}" for n in count(1))
    place = out or next(folder / name for name in names if not (folder / name).exists())
    with whole_folder(place) as part:
        commands = _written(menu, inputs, part, place)
        (part / "next.html").write_text(menu_page(menu, commands), encoding="utf-8")
    return [*_lines(menu), *commands], place / "next.html"


def opened(folder: Path, policy: Path | None = None) -> tuple[Inputs, Diagnosed]:
    """A diagnosis with what it was made of; ``policy`` is for walks, by default that of the logs.

    Raises:
        BadInputError: There is none, or one of another release, or of a robot other than Spot.
    """
    inputs, files = load_inputs(folder), [folder / NAMES[name] for name in ("verdict", "posterior", "robots")]
    if lacking := [file.name for file in files if not file.exists()]:
        raise BadInputError(f"{folder} holds no {lacking[0]}; the menu needs a whole diagnosis of Spot: diagnose again")
    try:
        verdict, posterior = load_verdict(files[0]), load_posterior(files[1])
    except ValidationError as error:
        told = f"{folder}: a diagnosis of another release, or damaged; diagnose again:\n{explain(error)}"
        raise BadInputError(told) from error
    runs, _ = read_logs([Path(p) for p in inputs.logs])
    file = policy or find_policy_file(None if inputs.policy is None else Path(inputs.policy), runs)
    walking = None if file is None else load_policy(file)
    runs = runs if walking is None else apart_by_gains(runs, walking)[0]
    nominal = merged(load_model(inputs.nominal))
    library = with_repairs(chosen_library(list(inputs.add_effect), list(inputs.without)), nominal)
    inputs = inputs.model_copy(update={"policy": None if file is None else str(file.absolute())})
    return inputs, Diagnosed(verdict, posterior, load_models(str(files[2])), nominal, library, runs, walking)


def load_motion(path: Path) -> Motion:
    """A user's own recording: a joint experiment, or velocity commands.

    Raises:
        BadInputError: The file cannot be read, is neither, or asks for what is never allowed.
    """
    data = read_yaml(path, "experiment")
    if isinstance(data, dict) and data.get("schema") == SCHEMA:
        return joint_experiment_from_data(data, source=f"joint experiment {path}")
    walk, (low, high) = load_sequence(str(path)), LASTS_S
    if not low <= walk.duration_s <= high:
        allowed = f"{low:g} to {high:g} s, as for a joint experiment; run a longer one with 'spot-rl run'"
        raise BadInputError(f"experiment {path}: duration_s is {walk.duration_s:g}; allowed: {allowed}")
    return walk


def _written(menu: Menu, inputs: Inputs, part: Path, place: Path) -> list[str]:
    """Write the best recording and ``menu.json`` into ``part``, named as they will lie in ``place``.

    Returns the commands that run it and then diagnose again; none where nothing is worth running.
    """
    commands: list[str] = []
    if menu.best is not None:
        motion, file = menu.best.candidate.motion, place / f"{menu.best.candidate.name}.yaml"
        what = f"--experiment {file}"
        if isinstance(motion, VelocitySequence):
            save_sequence(motion, part / file.name)
            what = f"--policy {inputs.policy} --sequence {file}"
        else:
            save_joint_experiment(motion, part / file.name)
        again = f"{' '.join(inputs.logs)} MORE_LOGS --nominal {inputs.nominal} --out OUT_2"
        commands = [f"spot-rl run {what} --log-dir MORE_LOGS --robot HOST", f"spot-rl diagnose {again}"]
    recordings = [
        {name: getattr(r.candidate, name) for name in ("name", "title", "robot_s", "needs")}
        | {name: getattr(r, name) for name in ("loads", "refused", "is_held", "gain")}
        | {"numbers": [{"title": d.title, "unit": d.unit, "now": d.now, "expected": r.after[d.key]} for d in r.doubts]}
        for r in menu.recordings
    ]
    best = None if menu.best is None else menu.best.candidate.name
    data = {"schema": "spot-rl/next-recordings/1", "best": best, "nothing": menu.nothing, "commands": commands}
    text = json.dumps({**data, "recordings": recordings}, indent=1)
    (part / "menu.json").write_text(f"{text}\n", encoding="utf-8")
    return commands


def _lines(menu: Menu) -> list[str]:
    """For a terminal."""
    if menu.best is None:
        return [f"nothing worth running: {menu.nothing}"]
    best, own = menu.best, menu.best.candidate
    refused = [f"refused: {r.candidate.name}: {reason}" for r in menu.recordings for reason in r.refused]
    return [f"run this next: {own.name}, {own.title}", *(f"  {told}" for told in (*best.told, best.cost)), *refused]
