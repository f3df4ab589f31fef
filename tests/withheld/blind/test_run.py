"""Many cases: each once, failures left for later, none begun after the budget."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from tests.withheld.scoring.made_up import outcome
from trainer.simulate.engine import Engine, Tell
from withheld.blind.execute import Job, case_folder
from withheld.blind.ledger import Ledger, read_ledger
from withheld.blind.run import run_cases
from withheld.outcome import Outcome

JOB = Job(0, 1, Path(), Path(), "audit hook")


def silent(*_: object) -> None:
    pass


def finish(job: Job) -> Outcome:
    """Leave what a case leaves."""
    folder = case_folder(job.out, job.number)
    folder.mkdir(parents=True)
    Ledger(folder / "ledger.jsonl").add("opened", case=job.number)
    (folder / "outcome.json").write_text(json.dumps(job.number))
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
    return [replace(JOB, number=i, out=out) for i in range(n)]


def test_every_case_is_run_once_and_entered(tmp_path: Path) -> None:
    engine, told = OneByOne(), []
    assert run_cases(jobs(tmp_path, 5), engine, tmp_path, 1e9, lambda *words: told.append(words[0])) == 0
    assert engine.begun == told == [0, 1, 2, 3, 4]
    assert [e.data["case"] for e in read_ledger(tmp_path / "ledger.jsonl")] == told


def test_what_failed_is_told_and_made_up_for(tmp_path: Path) -> None:
    told: list[str] = []
    assert run_cases(jobs(tmp_path, 3), OneByOne(broken=[1]), tmp_path, 1e9, lambda *words: told.append(words[1])) == 1
    assert sum("the disk is full" in t for t in told) == 1
    again = OneByOne()
    assert run_cases(jobs(tmp_path, 3), again, tmp_path, 1e9, silent) == 0
    assert again.begun == [1]


def test_after_the_budget_none_is_begun(tmp_path: Path) -> None:
    engine = OneByOne()
    assert run_cases(jobs(tmp_path, 3), engine, tmp_path, -1.0, silent) == 3
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
