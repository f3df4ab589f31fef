"""One case from draw to outcome: reality, seal, diagnosis behind the wall, digest of the verdict, opening."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from spot_log import read_run
from spot_model.errors import SpotRlError
from spot_model.io.model_file import load_model, save_model
from spot_model.policy.policy import load_policy
from withheld.blind import metadata, seal
from withheld.blind.jail import Ended, Level, hide_this_process, run_locked_in, seen
from withheld.blind.ledger import Ledger
from withheld.blind.seal import Seal, file_digest
from withheld.cases.draw import draw
from withheld.cases.sequences import fast_sequences, ordinary_sequences
from withheld.cases.source import source_of
from withheld.features import Walk
from withheld.measuring.consequences import consequences
from withheld.measuring.distances import SHRINK_REPEATS, TWIN_REPEATS, Shrunk, make_runs, moved, true_shrink
from withheld.outcome import Consequences, Outcome, load_outcome
from withheld.plan import Made, Reality, RecordingPlan, Truth
from withheld.simulator.simulation import RealityDivergedError
from withheld.verdict import Verdict, read_verdict

NO_VERDICT: Final = "none"
MAX_ATTEMPTS: Final = 5
"""Robots that may break their simulation before a case gives up."""
KEPT: Final = ("verdict.json", "report.html", "corrected_model.yaml")
NO_DISTANCE: Final = (SpotRlError, ValueError, np.linalg.LinAlgError)
"""What a robot that falls at once ends in."""


@dataclass(frozen=True)
class Job:
    """What a worker needs of one case."""

    number: int
    seed: int
    out: Path
    """The run's folder."""
    policies: Path
    level: Level
    reality: str = "judging"
    timeout_s: float = 900.0
    keep_logs: bool = False
    is_quick: bool = False


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
            return _Execution(job, Path(folder), result).run(done)
    finally:
        shutil.rmtree(result, ignore_errors=True)


class _Execution:
    """One case in the making: ``work`` is for logs, which go; ``result`` for what stays."""

    def __init__(self, job: Job, work: Path, result: Path) -> None:
        self.job, self.work, self.result = job, work, result
        self.source = source_of(job.reality)
        self._draw(0)
        self.seconds: dict[str, float] = {}

    def _draw(self, attempt: int) -> None:
        job = self.job
        self.case = draw(job.seed, job.number, self.source, job.policies, job.is_quick, attempt)
        self.policy = job.policies / f"{self.case.policy}.onnx"

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        before = time.process_time()
        yield
        self.seconds[stage] = round(time.process_time() - before, 2)

    def run(self, done: Path) -> Outcome:
        """Record, seal, diagnose, open and measure."""
        inside, out = self.work / "case", self.work / "out"
        (inside / "logs").mkdir(parents=True)
        out.mkdir()
        ledger = Ledger(self.result / "ledger.jsonl")
        with self._timed("recording"):
            reality, made = self._made(inside / "logs")
            self._give(reality, inside)
        sealed = Seal.of(reality.truth)
        ledger.add("sealed", case=self.case.number, truth=sealed.digest)
        ended = self._diagnose(inside, out)
        digest = self._taken(out)
        ledger.add("verdict", case=self.case.number, verdict=digest)
        # Only now: what was sealed leaves this process.
        ledger.add("opened", case=self.case.number, truth=sealed.digest, nonce=sealed.nonce, text=sealed.text)
        truth = seal.opened(sealed.digest, sealed.nonce, sealed.text)
        verdict, problem = self._verdict(ended)
        does = self._does(made.walks(load_policy(self.policy)), truth)
        shrunk = self._shrunk(reality, verdict)
        outcome = Outcome(
            case=self.case,
            truth=truth,
            verdict=verdict,
            moved=tuple(by for by, _ in does),
            consequences=tuple(own for _, own in does),
            true_s=shrunk.s,
            true_gaps=shrunk.gaps,
            metadata=metadata.features(inside, [read_run(p) for p in sorted(inside.glob("logs/*"))], self.case.without),
            seal=sealed.digest,
            verdict_sha256=digest,
            locked_in=self.job.level,
            seconds=self.seconds,
            problem=problem,
        )
        (self.result / "outcome.json").write_text(outcome.model_dump_json(by_alias=True, indent=1), encoding="utf-8")
        if self.job.keep_logs:
            shutil.move(inside, self.result / "given")
        done.parent.mkdir(exist_ok=True)
        shutil.rmtree(done, ignore_errors=True)
        os.rename(self.result, done)  # noqa: PTH104 - one step: a case is there whole or not at all
        return outcome

    def _made(self, logs: Path) -> tuple[Reality, Made]:
        """A robot that was recorded; one whose simulation breaks down is drawn anew."""
        for attempt in range(MAX_ATTEMPTS):
            self._draw(attempt)
            case = self.case
            reality = self.source.make(case.requests, case.reality_seed)
            plan = RecordingPlan(
                self.policy, case.sequences, case.repeats, case.recording_seed, frozenset(case.missing), case.detail
            )
            try:
                made = make_runs(reality, plan, logs)
            except RealityDivergedError:
                continue
            made.write(logs)
            return reality, made
        raise SpotRlError(f"case {self.case.number}: no robot in {MAX_ATTEMPTS} draws could be simulated")

    def _give(self, reality: Reality, inside: Path) -> None:
        """All that the diagnosis is given beside the logs: nominal model, and policy where a log would name it."""
        save_model(reality.nominal, inside / "model.yaml")
        if self.case.detail == "stream":
            shutil.copyfile(self.policy, inside / "policy.onnx")
        metadata.make_alike(inside / "logs")

    def _diagnose(self, inside: Path, out: Path) -> Ended:
        at, to = seen(inside, out, self.job.level)
        words = [f"{at}/logs", "--nominal", f"{at}/model.yaml", "--out", to]
        if self.case.detail == "stream":
            words += ["--policy", f"{at}/policy.onnx"]
        words += ["--seed", str(self.case.diagnosis_seed)]
        words += [w for name in self.case.without for w in ("--without", name)]
        ended = run_locked_in(inside, out, words, self.job.level, self.job.timeout_s)
        self.seconds["diagnosis"] = round(ended.cpu_s, 2)
        return ended

    def _taken(self, out: Path) -> str:
        """Digest of the verdict, which is moved with report and model to where the case is kept."""
        verdict = out / "verdict.json"
        digest = file_digest(verdict) if verdict.exists() else NO_VERDICT
        for name in KEPT:
            if (out / name).exists():
                shutil.move(out / name, self.result / name)
        return digest

    def _verdict(self, ended: Ended) -> tuple[Verdict | None, str]:
        """The verdict, and what went wrong."""
        path = self.result / "verdict.json"
        if not path.exists():
            lines = ended.said.strip().splitlines()
            return None, f"ended with {ended.code}: {lines[-1] if lines else ''}"
        try:
            return read_verdict(path), ""
        except SpotRlError as error:
            return None, str(error)[:300]

    def _does(self, walks: list[Walk], truth: Truth) -> list[tuple[float | None, Consequences | None]]:
        """How far each fault moves the gap, and what it does, by the same robot without it."""
        case, policy = self.case, load_policy(self.policy)
        found: list[tuple[float | None, Consequences | None]] = []
        with self._timed("distances"), tempfile.TemporaryDirectory(dir=self.work) as folder:
            for number in range(len(truth.faults) if self.source.kinds else 0):
                rest = case.requests[:number] + case.requests[number + 1 :]
                twin = self.source.make(rest, case.reality_seed)
                plan = RecordingPlan(self.policy, case.sequences, TWIN_REPEATS, case.recording_seed + 1 + number)
                try:
                    healthy = make_runs(twin, plan, Path(folder) / str(number)).walks(policy)
                except NO_DISTANCE:
                    found.append((None, None))
                    continue
                found.append((_moved(walks, healthy), consequences(walks, healthy)))
        return found

    def _shrunk(self, reality: Reality, verdict: Verdict | None) -> Shrunk:
        path = self.result / "corrected_model.yaml"
        if verdict is None or not verdict.differences or not path.exists():
            return Shrunk(None, {})
        case, policy = self.case, load_policy(self.policy)
        motion = fast_sequences if case.kind == "sprint" else ordinary_sequences
        new = motion(policy.contract, np.random.default_rng([case.recording_seed, 2]), case.sequences[0].duration_s)
        plan = RecordingPlan(self.policy, new, SHRINK_REPEATS, case.recording_seed + 9)
        with self._timed("true S"), tempfile.TemporaryDirectory(dir=self.work) as folder:
            try:
                reality.record(plan, Path(folder))
                runs = [read_run(log) for log in sorted(Path(folder).glob("*.mcap"))]
                return true_shrink(runs, reality.nominal, load_model(str(path)), policy, case.recording_seed)
            except NO_DISTANCE:
                return Shrunk(None, {})


def _moved(walks: list[Walk], healthy: list[Walk]) -> float | None:
    try:
        return moved(walks, healthy)
    except NO_DISTANCE:
        return None
