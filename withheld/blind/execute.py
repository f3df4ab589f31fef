"""One case from draw to outcome: reality, seal, diagnosis behind the wall, digest of the verdict, opening."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from pydantic import ValidationError

from diagnosis.verdict import load_verdict
from spot_log import Run
from spot_model.errors import SpotRlError
from spot_model.io.model_file import load_model, save_model
from spot_model.policy.policy import load_policy
from withheld.baselines import answers
from withheld.blind import metadata, seal
from withheld.blind.distances import TWIN_REPEATS, moved, read_folder, rehearse, true_shrink, walks_of
from withheld.blind.jail import Ended, Level, hide_this_process, run_locked_in, seen
from withheld.blind.ledger import Ledger
from withheld.blind.seal import Seal, file_digest
from withheld.cases.draw import Pace, draw
from withheld.cases.sequences import fast_sequences, ordinary_sequences
from withheld.cases.source import source_of
from withheld.plan import Reality, RecordingPlan, Walk
from withheld.scoring.outcome import Answer, Outcome, load_outcome
from withheld.scoring.scores import LARGE
from withheld.simulator.simulation import RealityDivergedError

NO_VERDICT: Final = "none"
TRUE_SHRINK_EVERY: Final = 5
"""The true shrink takes many more runs of the reality; it is measured in every fifth case."""
TRUE_REPEATS: Final = 4
NO_DISTANCE: Final = (SpotRlError, ValueError, np.linalg.LinAlgError)
"""What a robot that falls at once ends in."""
MAX_ATTEMPTS: Final = 5
"""Of robots that break their simulation."""
MAX_DRAWS: Final = 8
"""Of robots, until one moves the gap as a case asks; the last is kept, and counts with the small ones."""


@dataclass(frozen=True)
class Job:
    """What a worker needs of one case."""

    number: int
    seed: int
    out: Path
    """The run's folder."""
    policies: Path
    level: Level
    reality: str = ""
    timeout_s: float = 900.0
    is_searched: bool = False
    """Whether the paper's search is made on the case's logs."""
    keep_logs: bool = False
    pace: Pace = "full"


def case_folder(out: Path, number: int) -> Path:
    """Where a finished case lies."""
    return out / "cases" / f"{number:04d}"


def execute(job: Job) -> Outcome:
    """Run one case, and leave its folder behind.

    Raises:
        SpotRlError: A reality, a policy or the wall cannot be made.
        OSError: The disk.
    """
    done = case_folder(job.out, job.number)
    if (done / "outcome.json").exists():
        return load_outcome(done / "outcome.json")
    hide_this_process()
    result = job.out / "work" / f"{job.number:04d}"
    shutil.rmtree(result, ignore_errors=True)
    result.mkdir(parents=True)
    try:
        with tempfile.TemporaryDirectory(prefix="spot-rl-") as folder:
            # Another user has to reach what is inside, if that is how the diagnosis is locked in.
            Path(folder).chmod(0o711)
            return Execution(job, Path(folder), result).run(done)
    finally:
        shutil.rmtree(result, ignore_errors=True)


class Execution:
    """One case in the making.

    Args:
        job: What to do.
        work: Folder for logs, which go.
        result: Folder for what stays.
    """

    def __init__(self, job: Job, work: Path, result: Path) -> None:
        self.job, self.work, self.result = job, work, result
        self.source = source_of(job.reality)
        self._draw(0)
        self.seconds: dict[str, float] = {}
        self.moved: float | None = None
        """By the faults of the robot that was drawn last, where that had to be known before."""

    def _draw(self, attempt: int) -> None:
        job = self.job
        self.case = draw(job.seed, job.number, self.source, job.policies, job.pace, attempt)
        self.policy = job.policies / f"{self.case.policy}.onnx"

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        before = time.process_time()
        yield
        self.seconds[stage] = round(time.process_time() - before, 2)

    def run(self, done: Path) -> Outcome:
        """Record, seal, diagnose, open and measure."""
        inside, out = self.work / "case", self.work / "out"
        inside.mkdir()
        out.mkdir()
        ledger = Ledger(self.result / "ledger.jsonl")
        reality = self._record(inside)
        sealed = Seal.of(reality.truth)
        ledger.add("sealed", case=self.case.number, truth=sealed.digest)
        ended = self._diagnose(inside, out)
        digest = self._taken(out)
        ledger.add("verdict", case=self.case.number, verdict=digest)
        runs = read_folder(inside / "logs")
        said = self._baselines(runs, reality, inside / "logs")
        # Only now: what was sealed leaves this process.
        ledger.add("opened", case=self.case.number, truth=sealed.digest, nonce=sealed.nonce, text=sealed.text)
        outcome = Outcome(
            case=self.case,
            truth=seal.opened(sealed.digest, sealed.nonce, sealed.text),
            status="failed",
            baselines=said,
            metadata=metadata.features(inside, runs, self.case.without),
            seal=sealed.digest,
            verdict_sha256=digest,
            locked_in=self.job.level,
            seconds={},
            problem="" if ended.code == 0 else _last_line(ended),
        )
        outcome = self._measured(self._with_verdict(outcome), reality, runs)
        outcome = outcome.model_copy(update={"seconds": self.seconds})
        (self.result / "outcome.json").write_text(outcome.model_dump_json(by_alias=True, indent=1), encoding="utf-8")
        if self.job.keep_logs:
            shutil.move(inside, self.result / "given")
        done.parent.mkdir(exist_ok=True)
        shutil.rmtree(done, ignore_errors=True)
        os.rename(self.result, done)  # noqa: PTH104 - one step: a case is there whole or not at all
        return outcome

    def _record(self, inside: Path) -> Reality:
        """All that the diagnosis is given: logs, nominal model, policy."""
        with self._timed("recording"):
            reality = self.robot(inside / "logs")
        save_model(reality.nominal, inside / "model.yaml")
        shutil.copyfile(self.policy, inside / "policy.onnx")
        metadata.make_alike(inside / "logs")
        return reality

    def robot(self, logs: Path) -> Reality:
        """A robot that was recorded; one that breaks its simulation, or moves the gap too little, is drawn anew."""
        broken = 0
        for attempt in range(MAX_ATTEMPTS + MAX_DRAWS):
            self._draw(attempt)
            case = self.case
            reality = self.source.make(case.requests, case.reality_seed)
            missing = frozenset(case.missing)
            plan = RecordingPlan(self.policy, case.sequences, case.repeats, case.recording_seed, missing)
            shutil.rmtree(logs, ignore_errors=True)
            logs.mkdir()
            try:
                made = rehearse(reality, plan, logs)
            except RealityDivergedError:
                broken += 1
                if broken == MAX_ATTEMPTS:
                    break
                continue
            is_asked = case.is_asked and reality.truth.faults
            # A robot that is drawn anew leaves no log.
            if not is_asked or self._is_large(made.walks) or attempt - broken == MAX_DRAWS - 1:
                made.write(logs)
                return reality
        raise SpotRlError(f"case {self.case.number}: no robot in {MAX_ATTEMPTS} draws could be simulated")

    def _is_large(self, walks: Sequence[Walk]) -> bool:
        try:
            self.moved = self._moved(walks)
        except NO_DISTANCE:
            self.moved = None
        return self.moved is not None and self.moved >= LARGE

    def _taken(self, out: Path) -> str:
        """Digest of the verdict, which is moved with report and model to where the case is kept."""
        verdict = out / "verdict.json"
        digest = file_digest(verdict) if verdict.exists() else NO_VERDICT
        for name in ("verdict.json", "report.html", "corrected_model.yaml"):
            if (out / name).exists():
                shutil.move(out / name, self.result / name)
        return digest

    def _baselines(self, runs: Sequence[Run], reality: Reality, logs: Path) -> dict[str, Answer]:
        rng = np.random.default_rng([self.case.diagnosis_seed, 1])
        with self._timed("baselines"):
            return answers(runs, reality.nominal, self.policy, logs, rng, search=self.job.is_searched)

    def _diagnose(self, inside: Path, out: Path) -> Ended:
        at, to = seen(inside, out, self.job.level)
        words = [f"{at}/logs", "--nominal", f"{at}/model.yaml", "--policy", f"{at}/policy.onnx", "--out", to]
        words += ["--seed", str(self.case.diagnosis_seed)]
        words += [w for name in self.case.without for w in ("--without", name)]
        ended = run_locked_in(inside, out, words, self.job.level, self.job.timeout_s)
        self.seconds["diagnosis"] = round(ended.cpu_s, 2)
        return ended

    def _with_verdict(self, outcome: Outcome) -> Outcome:
        path = self.result / "verdict.json"
        if not path.exists():
            return outcome
        try:
            return outcome.with_verdict(load_verdict(path))
        except ValidationError as error:
            return outcome.model_copy(update={"problem": f"the verdict does not follow its schema: {error}"[:300]})

    def _measured(self, outcome: Outcome, reality: Reality, runs: Sequence[Run]) -> Outcome:
        """With how far the faults move the measure, and in some cases with the true shrink."""
        if not outcome.truth.faults or not self.source.kinds:
            return outcome
        with self._timed("distances"):
            try:
                known = self.moved if self.case.is_asked else None
                outcome = outcome.model_copy(update={"moved": self._moved(walks_of(runs)) if known is None else known})
                shrink = outcome.shrink
                if shrink is None or shrink.s is None or self.job.number % TRUE_SHRINK_EVERY:
                    return outcome
                true = shrink.model_copy(update={"true_s": self._true_shrink(reality)})
                return outcome.model_copy(update={"shrink": true})
            except NO_DISTANCE as error:
                # A robot that falls at once has no distance; what was said of it is scored all the same.
                return outcome.model_copy(update={"problem": f"distances: {error}"})

    def _moved(self, walks: Sequence[Walk]) -> float | None:
        case = self.case
        twin = self.source.make((), case.reality_seed)
        with tempfile.TemporaryDirectory(dir=self.work) as folder:
            plan = RecordingPlan(self.policy, case.sequences, TWIN_REPEATS, case.recording_seed + 1)
            return moved(walks, rehearse(twin, plan, Path(folder)).walks, load_policy(self.policy))

    def _true_shrink(self, reality: Reality) -> float | None:
        case, folder = self.case, self.work / "fresh"
        folder.mkdir()
        motion = fast_sequences if case.kind == "power" else ordinary_sequences
        rng = np.random.default_rng([case.recording_seed, 2])
        new = motion(load_policy(self.policy).contract, rng, case.sequences[0].duration_s)
        corrected = load_model(str(self.result / "corrected_model.yaml"))
        repeats = TRUE_REPEATS if self.job.pace == "full" else TWIN_REPEATS
        return true_shrink(reality, corrected, self.policy, new, repeats, case.recording_seed + 2, folder)


def _last_line(ended: Ended) -> str:
    lines = ended.said.strip().splitlines()
    return f"ended with {ended.code}: {lines[-1] if lines else ''}"
