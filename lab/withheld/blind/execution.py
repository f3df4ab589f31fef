"""Cases from draw to outcome: a reality records, a process that gets the logs diagnoses, and the judge measures."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from spot_log import Run
from spot_model.errors import SpotRlError
from spot_model.io.model_file import load_model, save_model
from spot_model.policy.policy import Policy, load_policy
from trainer.simulate.engine import ONE_THREAD, Engine, EngineError, Tell
from withheld.blind.run_folder import CASES, DRAWS, JUDGES_OWN, WORK
from withheld.cases import Case, draw, fast_sequences, ordinary_sequences
from withheld.measuring import (
    SHRINK_REPEATS,
    TWIN_REPEATS,
    Shrunk,
    Walk,
    consequences,
    moved,
    record_runs,
    true_shrink,
    walk_of_run,
)
from withheld.outcome import Consequences, Outcome, Verdict, read_outcome, read_verdict
from withheld.plan import Reality, RecordingPlan
from withheld.realities.source import Source, source_of
from withheld.simulator.simulation import RealityDivergedError

MAX_ATTEMPTS: Final = 5
"""Robots that may break their simulation before a case gives up."""
KEPT: Final = ("verdict.json", "report.html", "corrected_model.yaml")
NO_DISTANCE: Final = (SpotRlError, ValueError, np.linalg.LinAlgError)
"""What a robot that falls at once ends in."""
LAUNCH: Final = Path(__file__).with_name("launch.py")


class NotBlindError(SpotRlError):
    """A diagnosis opened what tells the truth of its case."""


@dataclass(frozen=True)
class Job:
    """What a worker needs of one case."""

    number: int
    seed: int
    out: Path
    """The run's folder."""
    policies: Path
    reality: str = "judging"
    timeout_s: float = 900.0
    keep_logs: bool = False
    is_quick: bool = False

    @property
    def folder(self) -> Path:
        """Where the finished case lies."""
        return self.out / CASES / f"{self.number:04d}"

    @property
    def is_done(self) -> bool:
        """Whether it does."""
        return (self.folder / "outcome.json").exists()


def run_cases(
    jobs: Sequence[Job],
    engine: Engine[Any, Job, Outcome],
    until_s: float,
    on_done: Callable[[int, str], None],
) -> int:
    """Run cases that are not there yet; returns how many are left.

    After ``until_s`` none is begun; those in the making are finished. A case that fails for a reason of its own is told
    of and left for ``--resume``.

    Args:
        jobs: All cases.
        engine: Where they run.
        until_s: Seconds from now.
        on_done: Called with number and text of each case that ends.
    """
    end_s = time.monotonic() + until_s
    waiting = [job for job in reversed(jobs) if not job.is_done]
    running: dict[Any, Job] = {}
    failed = 0
    while waiting or running:
        while waiting and len(running) < engine.places and time.monotonic() < end_s:
            job = waiting.pop()
            running[engine.start(job)] = job
        if not running:
            break
        for ticket in engine.finished(list(running), 10.0):
            job = running.pop(ticket)
            try:
                outcome = engine.result(ticket)
            except Exception as error:
                if isinstance(error, EngineError) and not engine.place.ray:
                    raise  # Without one of its processes, the pool does nothing more; a cluster goes on.
                failed += 1
                on_done(job.number, f"failed: {type(error).__name__}: {error}")
                continue
            on_done(job.number, f"{outcome.status}, {sum(outcome.seconds.values()):.0f} s")
    return len(waiting) + failed


def execute(_: None, job: Job, __: Tell) -> Outcome:
    """Run one case, and leave its folder behind; what an engine does with a job.

    Raises:
        NotBlindError: The diagnosis opened what tells the truth.
        SpotRlError: No reality or policy can be made.
        OSError: The disk.
    """
    if job.is_done:
        return read_outcome(job.folder / "outcome.json")
    result = job.out / WORK / job.folder.name
    shutil.rmtree(result, ignore_errors=True)
    result.mkdir(parents=True)
    try:
        with tempfile.TemporaryDirectory(prefix="spot-rl-") as work:
            outcome = _outcome(job, Path(work), result)
        (result / "outcome.json").write_text(outcome.model_dump_json(by_alias=True, indent=1), encoding="utf-8")
        job.folder.parent.mkdir(exist_ok=True)
        shutil.rmtree(job.folder, ignore_errors=True)
        os.rename(result, job.folder)  # noqa: PTH104 - one step: a case is there whole or not at all
        return outcome
    finally:
        shutil.rmtree(result, ignore_errors=True)


def _outcome(job: Job, work: Path, result: Path) -> Outcome:
    """Record, diagnose, and only then measure; logs go with ``work``, what is kept is left in ``result``."""
    seconds: dict[str, float] = {}
    given, out = work / "case", work / "out"
    given.mkdir()
    out.mkdir()
    with _timed(seconds, "recording"):
        case, reality, runs = recorded(job, given / "logs")
        save_model(reality.nominal, given / "model.yaml")
        policy_file = job.policies / f"{case.policy}.onnx"
        if case.detail == "stream":
            shutil.copyfile(policy_file, given / "policy.onnx")
    problem, seconds["diagnosis"] = diagnosed(job, case, given, out, work / "opened.txt")
    for path in (out / name for name in KEPT if (out / name).exists()):
        shutil.move(path, result / path.name)
    verdict, problem = _verdict(result / "verdict.json", problem)
    policy, source = load_policy(policy_file), source_of(job.reality)
    with _timed(seconds, "distances"):
        does = what_faults_do(source, case, reality, runs, policy, policy_file, work) if source.kinds else []
    with _timed(seconds, "true S"):
        shrunk = closed_gaps(case, reality, verdict, result / "corrected_model.yaml", policy, policy_file, work)
    outcome = Outcome(
        case=case,
        truth=reality.truth,
        verdict=verdict,
        moved=tuple(by for by, _ in does),
        consequences=tuple(own for _, own in does),
        true_s=shrunk.s,
        true_gaps=dict(shrunk.gaps),
        seconds=seconds,
        problem=problem,
    )
    if job.keep_logs:
        shutil.move(given, result / "given")
    return outcome


@contextmanager
def _timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    before = time.process_time()
    yield
    seconds[stage] = round(time.process_time() - before, 2)


def recorded(job: Job, logs: Path) -> tuple[Case, Reality, list[Run]]:
    """Draw a robot and record it; one whose simulation breaks down is drawn anew.

    Raises:
        SpotRlError: Too many broke down.
    """
    source = source_of(job.reality)
    for attempt in range(MAX_ATTEMPTS):
        case = draw(job.seed, job.number, source, job.policies, job.is_quick, attempt)
        reality = source.make(case.requests, case.reality_seed)
        plan = RecordingPlan(
            job.policies / f"{case.policy}.onnx",
            case.sequences,
            case.repeats,
            case.recording_seed,
            frozenset(case.missing),
            case.detail,
        )
        try:
            return case, reality, record_runs(reality, plan, logs)
        except RealityDivergedError:
            continue
    raise SpotRlError(f"case {job.number}: no robot in {MAX_ATTEMPTS} draws could be simulated")


def diagnosed(job: Job, case: Case, given: Path, out: Path, opened: Path) -> tuple[str, float]:
    """Run ``spot-rl diagnose`` in a process that is told of its own folders alone.

    Args:
        job: Whose files, and the code that draws cases, the process may not open.
        case: Whose effects are left out of the library.
        given: Folder of logs, nominal model and policy.
        out: Folder that the process writes.
        opened: File with the path of each file that it opened.

    Returns:
        How it ended, in words, and its CPU seconds.

    Raises:
        NotBlindError: It opened a file that it may not.
    """
    policy = given / "policy.onnx"
    words = ["logs", "--nominal", "model.yaml", "--out", str(out), "--seed", str(case.diagnosis_seed)]
    words += ["--policy", policy.name] if policy.exists() else []
    words += [w for name in case.without for w in ("--without", name)]
    paths = os.pathsep.join(str(Path(entry).absolute()) for entry in sys.path)
    environment = {**os.environ, "PYTHONPATH": paths, "MUJOCO_GL": "disable", **dict.fromkeys(ONE_THREAD, "1")}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    try:
        done = subprocess.run(  # noqa: S603 - our own command
            [sys.executable, "-P", str(LAUNCH), str(opened), *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=job.timeout_s,
            check=False,
            cwd=given,
            env=environment,
        )
        code, said = str(done.returncode), done.stdout.decode(errors="replace")
    except subprocess.TimeoutExpired:
        code, said = f"no result after {job.timeout_s:g} s", ""
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    for path in map(Path, opened.read_text(errors="surrogateescape").splitlines() if opened.exists() else ()):
        if any(path.is_relative_to(own) for own in (*(job.out / name for name in JUDGES_OWN), *DRAWS)):
            raise NotBlindError(
                f"case {job.number}: the diagnosis opened {path}, which tells what is hidden; allowed: its own logs, "
                "model and policy. Take that out of the diagnosis; the case is not scored"
            )
    lines = said.strip().splitlines()
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return f"ended with {code}: {lines[-1] if lines else ''}", round(cpu_s, 2)


def _verdict(file: Path, ended: str) -> tuple[Verdict | None, str]:
    """The verdict, and what went wrong."""
    if not file.exists():
        return None, ended
    try:
        return read_verdict(file), ""
    except SpotRlError as error:
        return None, str(error)[:300]


def what_faults_do(
    source: Source, case: Case, reality: Reality, runs: Sequence[Run], policy: Policy, policy_file: Path, work: Path
) -> list[tuple[float | None, Consequences | None]]:
    """Measure how far each fault moves the gap, and what it does, by the same robot without it.

    Args:
        source: Of realities whose faults a case asks for.
        case: Which.
        reality: With all faults.
        runs: Its logs as the diagnosis got them.
        policy: That walked it.
        policy_file: Of that policy.
        work: For logs.

    Returns:
        Of each fault, its distance in floors and its consequences; None where there is none to be measured.
    """
    if not case.requests:
        return []
    plan = RecordingPlan(policy_file, case.sequences, case.repeats, case.recording_seed)
    with tempfile.TemporaryDirectory(dir=work) as folder:
        if case.missing or case.detail == "import":
            # The same runs, with the signals that the logs of the diagnosis lack.
            runs = record_runs(reality, plan, Path(folder) / "whole")
        walks = [walk_of_run(run, policy) for run in runs]
        found: list[tuple[float | None, Consequences | None]] = []
        for number in range(len(case.requests)):
            rest = case.requests[:number] + case.requests[number + 1 :]
            twin = source.make(rest, case.reality_seed)
            twins = replace(plan, repeats=TWIN_REPEATS, seed=case.recording_seed + 1 + number)
            try:
                without = record_runs(twin, twins, Path(folder) / str(number))
            except NO_DISTANCE:
                found.append((None, None))
                continue
            healthy = [walk_of_run(run, policy) for run in without]
            found.append((_moved(walks, healthy), consequences(walks, healthy)))
    return found


def _moved(walks: list[Walk], healthy: list[Walk]) -> float | None:
    try:
        return moved(walks, healthy)
    except NO_DISTANCE:
        return None


def closed_gaps(
    case: Case, reality: Reality, verdict: Verdict | None, model: Path, policy: Policy, policy_file: Path, work: Path
) -> Shrunk:
    """Measure how much of each gap a delivered model closes on new sequences; nothing without a stated difference."""
    if verdict is None or not verdict.differences or not model.exists():
        return Shrunk()
    motion = fast_sequences if case.kind == "sprint" else ordinary_sequences
    new = motion(policy.contract, np.random.default_rng([case.recording_seed, 2]), case.sequences[0].duration_s)
    plan = RecordingPlan(policy_file, new, SHRINK_REPEATS, case.recording_seed + 9)
    with tempfile.TemporaryDirectory(dir=work) as folder:
        try:
            # What the simulated runs draw follows the order of the logs, which is that of their random names.
            runs = sorted(record_runs(reality, plan, Path(folder)), key=lambda run: str(run.path))
            return true_shrink(runs, reality.nominal, load_model(str(model)), policy, case.recording_seed)
        except NO_DISTANCE:
            return Shrunk()
