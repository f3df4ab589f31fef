"""What is written of a design: an experiment file each, with the command that runs it, and the ranking as data."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Final

from diagnosis.next.candidates import Motion
from diagnosis.next.design import Design
from spot_model.errors import BadInputError
from spot_model.io.joint_experiment import SCHEMA as JOINT_EXPERIMENT
from spot_model.io.joint_experiment import joint_experiment_from_data, save_joint_experiment
from spot_model.io.velocity_sequence import VelocitySequence, load_sequence, save_sequence
from spot_model.io.yaml_text import read_yaml

LASTS_S: Final = (4.0, 60.0)
"""Length of a walk that is judged, s: it is simulated on some seventy robots."""


def free_folder(parent: Path, name: str) -> Path:
    """``parent/name``, or the first of ``name-2``, ``name-3`` ... that is not there; made."""
    for number in count(1):
        folder = parent / (name if number == 1 else f"{name}-{number}")
        with suppress(FileExistsError):
            folder.mkdir(parents=True)
            break
    return folder


def save_motion(motion: Motion, path: Path) -> None:
    """Write an experiment for ``spot-rl run``; refuses to overwrite."""
    if isinstance(motion, VelocitySequence):
        save_sequence(motion, path)
    else:
        save_joint_experiment(motion, path)


def load_motion(path: Path) -> Motion:
    """A user's own experiment: a joint experiment, or velocity commands.

    Raises:
        BadInputError: The file cannot be read, is neither, or asks for what is never allowed.
    """
    data = read_yaml(path, "experiment")
    if isinstance(data, dict) and data.get("schema") == JOINT_EXPERIMENT:
        return joint_experiment_from_data(data, source=f"joint experiment {path}")
    walk = load_sequence(str(path))
    low, high = LASTS_S
    if not low <= walk.duration_s <= high:
        raise BadInputError(
            f"experiment {path}: duration_s is {walk.duration_s:g}; allowed: {low:g} to {high:g} s, as for a joint "
            "experiment; run a longer one with 'spot-rl run'"
        )
    return walk


def run_words(motion: Motion, file: Path, policy: str | None, log_dir: str) -> list[str]:
    """Arguments of ``spot-rl`` that run an experiment; where the robot is comes after them."""
    what = ["--experiment", str(file)]
    if isinstance(motion, VelocitySequence):
        what = ["--policy", policy or "POLICY.onnx", "--sequence", str(file)]
    return ["run", *what, "--log-dir", log_dir]


def write_offers(design: Design, part: Path, folder: Path, policy: str | None) -> dict[str, str]:
    """Write the experiments that are safe and worth their time, the most telling first, and ``ranking.json``.

    They are written into ``part`` and named as they will lie in ``folder``. Returns the command of each for a terminal,
    by the experiment's name.
    """
    commands = {}
    for number, proposal in enumerate(design.worthwhile, start=1):
        name = proposal.candidate.name
        file = folder / f"{number:02d}_{name}.yaml"
        save_motion(proposal.motion, part / file.name)
        words = run_words(proposal.motion, file, policy, "MORE_LOGS")
        commands[name] = " ".join(["spot-rl", *words, "--robot", "HOST"])
    data = {
        "schema": "spot-rl/next-experiments/1",
        "causes": design.odds,
        "experiments": [
            {
                "name": p.candidate.name,
                "values": p.candidate.chosen,
                "bits": round(p.told.bits, 4),
                "robot_s": p.robot_s,
                "decides": p.decides(design.causes, design.weights),
                "loads": p.burden,
                "needs": p.candidate.needs,
                "refused": list(p.refused),
                "command": commands.get(p.candidate.name, ""),
            }
            for p in design.proposals
        ],
    }
    (part / "ranking.json").write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    return commands


def ranking_lines(design: Design, commands: Mapping[str, str]) -> list[str]:
    """For a terminal; ``commands`` are those of :func:`write_offers`."""
    lines = ["possible causes", *(f"  {odds:5.2f}  {cause}" for cause, odds in design.odds.items())]
    for number, p in enumerate(design.proposals, start=1):
        lines += ["", f"{number}. {p.candidate.title}{f' ({p.values})' if p.values else ''}"]
        if p.refused:
            lines += [f"   refused: {reason}" for reason in p.refused]
            continue
        lines.append(f"   information  {p.information}, {p.bits_a_second:.3f} bits a second")
        if p.told.bits > 0.0:
            lines.append(f"   separates    {p.decides(design.causes, design.weights)}")
        lines.append(f"   loads        {p.burden}; needs {p.candidate.needs}")
        if p.candidate.name in commands:
            lines.append(f"   run          {commands[p.candidate.name]}")
    return lines
