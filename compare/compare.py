"""One comparison from a log and what it is compared with, another log or a simulated model, to files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from compare.cause import Cause, cause_in_words, causes
from compare.differences import SIGNALS, Differences, differences
from compare.ghost import write_ghosts
from compare.layout import foxglove_layout
from compare.page import comparison_page, difference_sentence, stretch
from compare.tracks import STEP_S, CompareError, Track, aligned_tracks, track_of
from diagnosis.document import Verdict
from diagnosis.read import find_policy
from spot_log.read.reader import read_run
from spot_log.read.run import Run
from spot_model.io.model_file import BUILT_IN, RobotModel, load_model
from spot_model.io.whole import whole_folder
from spot_model.policy.policy import Policy
from spot_model.robot.facts import JOINT_NAMES
from trainer.signals.policy_ticks import script_of
from trainer.simulate.recorded_runs import UsualNoise, simulate_scripts


def is_model(name: str) -> bool:
    """Whether a word of the command line names a model: a built-in one, or a YAML file."""
    return name in BUILT_IN or Path(name).suffix in (".yaml", ".yml")


def read_reference(path: str) -> Run:
    """The first run, which must be a log.

    Raises:
        CompareError: It names a model.
        LogReadError: It is not a log.
    """
    if is_model(path):
        raise CompareError(f"{path} is a model; the first run must be a log (*.mcap): models follow its commands")
    return read_run(Path(path))


def read_other(name: str, reference: Run, policy: Path | None, seed: int) -> Run:
    """A log, or the reference's commands on a simulated robot.

    Raises:
        CompareError: A model is named and nothing can be simulated.
        SpotRlError: A file is not valid.
    """
    if not is_model(name):
        if not Path(name).exists():
            models = ", ".join(BUILT_IN)
            raise CompareError(
                f"{name!r} is not a file; allowed: a log (*.mcap), a model file (YAML), or one of {models}"
            )
        return read_run(Path(name))
    found = find_policy(policy, [reference])
    if found is None:
        raise CompareError(
            f"{name} cannot be simulated: neither a built-in policy nor a file in ./policies has the log's digest "
            f"{reference.header.policy_sha256[:12] or '(none)'}…; give the policy that ran, --policy FILE"
        )
    return simulate_like(reference, load_model(name), found, np.random.default_rng(seed))


def simulate_like(
    run: Run, model: RobotModel, policy: Policy, rng: np.random.Generator, noise: UsualNoise | None = None
) -> Run:
    """Put a model through a log's velocity commands, from the state in which the policy took over.

    Args:
        run: The log.
        model: The simulated robot.
        policy: What controls it.
        rng: Draws the noise of the sensors and the delays.
        noise: Of the sensors; a real Spot's size by default.

    Returns:
        A run in memory with the same arrays as a log's; it has no IMU packets, polls, events or footer.

    Raises:
        CompareError: The log has less than a second under a policy.
    """
    script = script_of(run)
    if script is None:
        raise CompareError(f"{run.path} has less than a second under a policy; nothing can be simulated from it")
    return simulate_scripts(model, policy, [script], rng, noise or UsualNoise())[0]


PAGE_NAME: Final = "compare.html"
LOG_NAME: Final = "compare.mcap"
DATA_NAME: Final = "compare.json"
LAYOUT_NAME: Final = "layout.foxglove.json"
FILES: Final = (PAGE_NAME, LOG_NAME, DATA_NAME, LAYOUT_NAME)
SCHEMA: Final = "spot-rl/compare/1"


@dataclass(frozen=True)
class Named:
    """A run and what it is called."""

    name: str
    run: Run
    is_simulated: bool = False


@dataclass(frozen=True)
class Comparison:
    """Aligned runs and their differences from the first."""

    tracks: tuple[Track, ...]
    """The runs as arrays on one time grid of 10 ms, in the order given; below."""
    differences: tuple[Differences, ...]
    """Differences of each run but the first; described below."""
    causes: tuple[Cause, ...] = ()
    """When the diagnosis' effects act, if there is a diagnosis."""
    cause: str = ""
    """What the diagnosis says, in words."""
    notes: tuple[str, ...] = ()
    """What could not be compared, a sentence each."""

    def __repr__(self) -> str:
        """The sentences: the arrays would fill a screen."""
        return f"<Comparison: {' '.join(self.sentences)}>"

    @property
    def sentences(self) -> tuple[str, ...]:
        """What differs most, one sentence for each other run; then which part of each run is compared."""
        return (*(difference_sentence(self.tracks[0], d) for d in self.differences), stretch(self.tracks))

    def to_json(self) -> dict[str, Any]:
        """The figures as plain data."""
        return {
            "schema": SCHEMA,
            "reference": self.tracks[0].name,
            "seconds": round(len(self.tracks[0]) * STEP_S, 3),
            "cause": self.cause,
            "compared": stretch(self.tracks),
            "notes": list(self.notes),
            "runs": [_figures(d) for d in self.differences],
        }


def named(runs: Sequence[Named]) -> list[Named]:
    """The same runs with short names: a log by its policy, sequence and repeat, a model by its file's name.

    Runs that would share a name keep the file's, and where those are equal, too, the whole path.
    """
    for shorten in (_title, _file_name):
        names = [shorten(r) for r in runs]
        if len(set(names)) == len(names):
            return [replace(r, name=name) for r, name in zip(runs, names, strict=True)]
    return [replace(r, name=f"{i}: {r.name}") for i, r in enumerate(runs, start=1)]


def _title(run: Named) -> str:
    header = run.run.header
    if run.is_simulated or not (header.policy_name and header.command_sequence):
        return _file_name(run)
    return f"{header.policy_name} {header.command_sequence} r{header.repeat}"


def _file_name(run: Named) -> str:
    return Path(run.name).name.partition(".mcap")[0].removesuffix(".yaml")


def compare_runs(runs: Sequence[Named], verdict: Verdict | None = None) -> Comparison:
    """Align runs by their velocity commands and take their differences from the first.

    Raises:
        CompareError: There are fewer than two, or they cannot be compared.
    """
    if len(runs) < 2:
        raise CompareError("a comparison needs two runs: a log, and another log or a model")
    tracks = aligned_tracks([track_of(r.run, r.name, is_simulated=r.is_simulated) for r in runs])
    notes = [f"{r.name}: {text}" for r in runs for text in r.run.damage]
    untold = [t.name for t in tracks if np.isnan(t.velocity_command).all()]
    if untold:
        notes.append(
            f"{' and '.join(untold)} holds no velocity commands: the starts are aligned, and nothing shows that "
            "the commands were the same"
        )
    found = Comparison(tuple(tracks), tuple(differences(tracks[0], t) for t in tracks[1:]), notes=tuple(notes))
    if verdict is None:
        return found
    marked = tuple(causes(verdict, runs[0].run, tracks[0]))
    return replace(found, causes=marked, cause=cause_in_words(verdict))


def write_comparison(found: Comparison, out: Path, beside_m: float = 0.7) -> dict[str, Path]:
    """Write page, ghost log, figures and a Foxglove layout into a folder.

    Raises:
        OutputExistsError: One of them is there.
        OSError: They cannot be written.
    """
    paths = {name: out / name for name in FILES}
    layout = json.dumps(foxglove_layout(), indent=1, ensure_ascii=False) + "\n"
    page = comparison_page(found.tracks, found.differences, found.causes, found.cause, found.notes)
    with whole_folder(out) as part:
        write_ghosts(part / LOG_NAME, found.tracks, found.differences, found.causes, beside_m)
        (part / PAGE_NAME).write_text(page, encoding="utf-8")
        (part / DATA_NAME).write_text(json.dumps(found.to_json(), indent=1) + "\n", encoding="utf-8")
        (part / LAYOUT_NAME).write_text(layout, encoding="utf-8")
    return paths


def _figures(found: Differences) -> dict[str, Any]:
    signals = {
        name: {
            "unit": unit,
            "distance": _by_joint(found.signals[name].distance),
            "rms": _by_joint(found.signals[name].rms),
            "spread": _by_joint(found.signals[name].spread),
        }
        for name, unit in SIGNALS.items()
    }
    return {
        "name": found.name,
        "forward_speed_m_s": [_number(v) for v in found.forward_speed_m_s],
        "speed_error_m_s": [_number(v) for v in found.speed_error_m_s],
        "end_distance_m": _number(found.end_distance_m),
        "signals": signals,
    }


def _by_joint(values: np.ndarray) -> dict[str, float | None]:
    return {name: _number(float(v)) for name, v in zip(JOINT_NAMES, values, strict=True)}


def _number(value: float) -> float | None:
    return round(value, 6) if np.isfinite(value) else None
