"""Cases: each once, failures left for later; which robot a case keeps, and what each of its faults does."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from spot_model.errors import SpotRlError
from spot_model.policy.policy import load_policy
from tests.withheld.scoring.made_up import outcome, verdict
from tests.withheld.stand_in import StandIn
from trainer.simulate.engine import Engine, Tell
from withheld.blind.execution import (
    MAX_ATTEMPTS,
    Job,
    NotBlindError,
    closed_gaps,
    diagnosed,
    recorded,
    run_cases,
    what_faults_do,
)
from withheld.cases import draw
from withheld.measuring import Shrunk
from withheld.outcome import Outcome
from withheld.plan import RecordingPlan
from withheld.realities.source import source_of
from withheld.simulator.simulation import RealityDivergedError

POLICIES = Path("policies")
SEED = 11


class Broken(StandIn):
    """Breaks every simulation."""

    def record(self, plan: RecordingPlan, folder: Path) -> None:
        raise RealityDivergedError("not a number")


def job(out: Path, reality: str, kind: str) -> Job:
    name = f"tests.withheld.{reality}"
    number = next(n for n in range(80) if draw(SEED, n, source_of(name), POLICIES).kind == kind)
    return Job(number, SEED, out, POLICIES, name, is_quick=True)


def test_a_robot_that_breaks_is_drawn_anew(tmp_path: Path) -> None:
    brittle = job(tmp_path, "stand_in:Brittle", "single")
    case, _, runs = recorded(brittle, tmp_path)
    assert case == draw(SEED, brittle.number, source_of(brittle.reality), POLICIES, True, 1)
    assert len(runs) == case.repeats * len(case.sequences)


def test_robots_that_all_break_end_the_case(tmp_path: Path) -> None:
    with pytest.raises(SpotRlError, match=f"no robot in {MAX_ATTEMPTS} draws"):
        recorded(job(tmp_path, "blind.test_execution:Broken", "single"), tmp_path)


READS = {
    "an outcome": "open(run / 'cases/0001/outcome.json').read()",
    "the seed": "(run / 'run.json').read_text()",
    "the seed, by its descriptor": "os.open(run / 'run.json', os.O_RDONLY)",
    "a link": "[os.symlink(run / 'run.json', out / 'x'), open(out / 'x').read()]",
    "dots": "open(out / '..' / 'run' / 'run.json').read()",
    "bytes": "open(os.fsencode(run / 'run.json')).read()",
    "what draws cases": "__import__('withheld.cases')",
    "an error that is hidden": "open(run / 'cases/0002/outcome.json').read()",
}
HONEST = {
    "a log": "open('logs/log.mcap').read()",
    "a result": "(out / 'verdict.json').write_text('{}')",
    "libraries": "__import__('numpy')",
    "a neighbour of the run": "open(run.parent / 'other.txt', 'w')",
    "a descriptor": "open(os.dup(0)).close()",
}


def diagnosis_that(does: str, where: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, float]:
    """Run another program in place of the diagnosis."""
    run, given, out = where / "run", where / "given", where / "out"
    for folder in (where / "diagnosis", given / "logs", out, run / "cases" / "0001"):
        folder.mkdir(parents=True)
    (where / "diagnosis" / "__init__.py").touch()
    (where / "diagnosis" / "command.py").write_text(
        "import os\nfrom pathlib import Path\n"
        f"run, out = Path({str(run)!r}), Path({str(out)!r})\n"
        f"def diagnose(words):\n    try:\n        {does}\n    except OSError:\n        pass\n    print(words)\n"
    )
    for file in (run / "run.json", run / "cases" / "0001" / "outcome.json", given / "logs" / "log.mcap"):
        file.write_text("{}")
    monkeypatch.syspath_prepend(str(where))
    case = draw(SEED, 0, source_of("judging"), POLICIES)
    return diagnosed(Job(7, SEED, run, POLICIES), case, given, out, where / "opened.txt")


@pytest.mark.parametrize("does", READS.values(), ids=READS)
def test_a_diagnosis_that_cheats_is_noticed(does: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(NotBlindError, match=r"^case 7: the diagnosis opened .*, which tells"):
        diagnosis_that(does, tmp_path, monkeypatch)


@pytest.mark.parametrize("does", HONEST.values(), ids=HONEST)
def test_one_that_does_not_is_told_its_own_folders_alone(
    does: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ended, cpu_s = diagnosis_that(does, tmp_path, monkeypatch)
    assert ended.startswith("ended with 0: ['logs', '--nominal', 'model.yaml', '--out', ")
    assert str(tmp_path / "run") not in ended
    assert cpu_s > 0.0


@pytest.mark.slow
def test_each_fault_is_measured_by_leaving_it_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("withheld.blind.execution.TWIN_REPEATS", 1)
    double = job(tmp_path, "stand_in:StandIn", "double")
    case, reality, runs = recorded(double, tmp_path / "logs")
    policy = POLICIES / f"{case.policy}.onnx"
    source = source_of(double.reality)
    (first, one), (second, other) = what_faults_do(source, case, reality, runs, load_policy(policy), policy, tmp_path)
    assert None not in (first, second)
    assert first != second
    assert one is not None
    assert other is not None
    # Both are the change to the same robot, with both faults.
    assert one.power.after == other.power.after
    assert one.power.before != other.power.before
    # What the logs of the diagnosis lack is measured all the same.
    lacking = case.model_copy(update={"missing": ("load",)})
    again = what_faults_do(source, lacking, reality, [], load_policy(policy), policy, tmp_path)
    assert again == [(first, one), (second, other)]


def test_what_a_verdict_without_a_difference_delivers_is_not_measured(tmp_path: Path) -> None:
    case = draw(SEED, 0, source_of("judging"), POLICIES)
    policy = POLICIES / f"{case.policy}.onnx"
    model = tmp_path / "corrected_model.yaml"
    model.touch()
    assert closed_gaps(case, StandIn(SEED, ()), verdict(), model, load_policy(policy), policy, tmp_path) == Shrunk()


def finish(job: Job) -> Outcome:
    """Leave what a case leaves."""
    job.folder.mkdir(parents=True)
    (job.folder / "outcome.json").touch()
    return outcome(number=job.number)


class OneByOne(Engine[Sequence[int], Job, Outcome]):
    """In this process; some cases are broken."""

    def __init__(self, broken: Sequence[int] = ()) -> None:
        super().__init__(self._finish, broken)
        self.begun: list[int] = []

    def _finish(self, broken: Sequence[int], job: Job, _: Tell) -> Outcome:
        self.begun.append(job.number)
        if job.number in broken:
            raise ValueError("the disk is full")
        return finish(job)


def jobs(out: Path, n: int) -> list[Job]:
    return [replace(Job(0, 1, out, Path()), number=i) for i in range(n)]


def test_every_case_is_run_once_and_what_failed_is_told_and_made_up_for(tmp_path: Path) -> None:
    engine, told = OneByOne(broken=[1]), dict[int, str]()
    assert run_cases(jobs(tmp_path, 4), engine, 1e9, told.__setitem__) == 1
    assert engine.begun == list(told) == [0, 1, 2, 3]
    assert "the disk is full" in told[1]
    again = OneByOne()
    assert run_cases(jobs(tmp_path, 4), again, 1e9, told.__setitem__) == 0
    assert again.begun == [1]
    assert all(job.is_done for job in jobs(tmp_path, 4))


def test_after_the_budget_none_is_begun(tmp_path: Path) -> None:
    engine = OneByOne()
    assert run_cases(jobs(tmp_path, 3), engine, -1.0, lambda *_: None) == 3
    assert not engine.begun


SLOW_CASES = """
import sys, time
from pathlib import Path
from trainer.simulate.engine import Engine, Place
def wait(_, folder, __):
    import os, subprocess
    Path(folder, str(os.getpid())).touch()
    subprocess.run([sys.executable, "-c", "import ctypes; ctypes.CDLL(None).prctl(1, 9, 0, 0, 0);"
                    f"import os, time, pathlib; pathlib.Path({folder!r}, str(os.getpid())).touch(); time.sleep(600)"])
if __name__ == "__main__":
    with Engine(wait, None, Place(is_apart=True)) as engine:
        engine.map([sys.argv[1]])
"""


def is_alive(pid: int) -> bool:
    try:
        return "Z" not in Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0]
    except FileNotFoundError:
        return False


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_worker_outlives_the_run(tmp_path: Path, number: signal.Signals) -> None:
    script, marks = tmp_path / "slow_cases.py", tmp_path / "marks"
    script.write_text(SLOW_CASES)
    marks.mkdir()
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    run = subprocess.Popen(
        [sys.executable, str(script), str(marks)], env=environment, stderr=subprocess.DEVNULL, start_new_session=True
    )
    while len(list(marks.iterdir())) < 2:
        assert run.poll() is None
        time.sleep(0.1)
    run.send_signal(number)
    run.wait()
    pids = [int(p.name) for p in marks.iterdir()]
    while any(map(is_alive, pids)):
        time.sleep(0.1)
