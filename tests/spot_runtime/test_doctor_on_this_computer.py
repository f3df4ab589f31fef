"""The doctor's checks of the computer, on computers made by hand; the quota of the logs."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
import tomllib

from spot_log.tools.retention import LogFile, closed_logs, prune_logs, to_delete
from spot_model.errors import BadInputError
from spot_runtime.config import RunConfig
from spot_runtime.rescue.lease_note import HeldNote, LeaseNote, note_path
from spot_tools import computer_checks as computer
from spot_tools.checks import Check, Finding, Verdict, is_fit, ok
from spot_tools.computer_checks import Host
from spot_tools.doctor import line_of
from spot_tools.robot_checks import judge_expiry, judge_latency

REPOSITORY = Path(__file__).resolve().parents[2]


class HandMadeHost(Host):
    """A computer whose every answer the test gives."""

    def __init__(self, root: Path = Path("/nowhere"), **answers: object) -> None:
        super().__init__(root)
        self._answers = answers

    def python_version(self) -> tuple[int, int, int]:
        return self._answers.get("python", (3, 10, 12))  # type: ignore[return-value]

    def machine(self) -> str:
        return str(self._answers.get("machine", "aarch64"))

    def requirements(self, package: str) -> list[str]:
        return self._answers.get("requirements", [])  # type: ignore[return-value]

    def installed_version(self, package: str) -> str | None:
        return self._answers.get("installed", {}).get(package)  # type: ignore[attr-defined,no-any-return]

    def fifo_refusal(self, priority: int) -> str:
        return str(self._answers.get("fifo", ""))

    def memory_lock_refusal(self) -> str:
        return str(self._answers.get("lock", ""))

    def free_bytes(self, folder: Path) -> int | None:
        return self._answers.get("free")  # type: ignore[return-value]

    def note_folder(self) -> Path:
        return Path(str(self._answers.get("notes", "/nowhere")))

    def usable_cpus(self) -> set[int]:
        return {0, 1, 2, 3}


def files(root: Path, **contents: str) -> Path:
    for name, content in contents.items():
        path = root / name.replace("__", "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content + "\n")
    return root


@pytest.mark.parametrize(
    ("version", "machine", "verdict"),
    [
        ((3, 9, 2), "aarch64", Verdict.FAIL),
        ((3, 10, 12), "aarch64", Verdict.OK),
        ((3, 12, 3), "x86_64", Verdict.OK),
        ((3, 13, 0), "aarch64", Verdict.WARN),
        ((3, 12, 3), "armv7l", Verdict.WARN),
    ],
)
def test_python(version: tuple[int, int, int], machine: str, verdict: Verdict) -> None:
    assert computer.python(HandMadeHost(python=version, machine=machine)).verdict is verdict


REQUIREMENTS = [
    "typer==0.29.1",
    'numpy==2.2.6; python_version < "3.11" and extra == "runtime"',
    'numpy==2.4.6; python_version >= "3.11" and extra == "runtime"',
    'torch==2.13.0; extra == "train"',
]


def test_packages() -> None:
    def look(**installed: str) -> Finding:
        return computer.packages(HandMadeHost(requirements=REQUIREMENTS, installed=installed))

    assert look(typer="0.29.1", numpy="2.2.6").verdict is Verdict.OK
    assert look(typer="0.29.1", numpy="2.4.6").verdict is Verdict.OK
    missing = look(typer="0.29.1")
    assert (missing.verdict, missing.found) == (Verdict.FAIL, "missing: numpy")
    other = look(typer="0.29.1", numpy="2.0.0")
    assert (other.verdict, other.found) == (Verdict.WARN, "other versions: numpy 2.0.0 (made for 2.2.6 or 2.4.6)")
    assert computer.packages(HandMadeHost()).verdict is Verdict.FAIL


def test_the_pins_are_those_of_the_project() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    stated = {re.split("==", line)[0] for line in project["dependencies"] + project["optional-dependencies"]["runtime"]}
    assert set(computer.runtime_pins(Host().requirements("spot-rl"))) == stated


def test_governor(tmp_path: Path) -> None:
    assert computer.cpu_governor(HandMadeHost(tmp_path)).verdict is Verdict.SKIPPED
    where = "sys__devices__system__cpu__cpu{}__cpufreq__scaling_governor"
    host = HandMadeHost(files(tmp_path, **{where.format(0): "performance", where.format(1): "schedutil"}))
    finding = computer.cpu_governor(host)
    assert (finding.verdict, finding.found) == (Verdict.WARN, "schedutil on some of 2 CPUs")
    files(tmp_path, **{where.format(1): "performance"})
    assert computer.cpu_governor(host).verdict is Verdict.OK


def test_isolation(tmp_path: Path) -> None:
    host = HandMadeHost(files(tmp_path, sys__devices__system__cpu__isolated="2-3"))
    assert computer.cpu_isolation(host, ()).verdict is Verdict.SKIPPED
    assert computer.cpu_isolation(host, (2, 3)).verdict is Verdict.OK
    finding = computer.cpu_isolation(host, (1, 2))
    assert (finding.verdict, finding.advice) == (Verdict.WARN, "add isolcpus=1 to the kernel's command line")
    finding = computer.cpu_isolation(host, (2, 7))
    assert (finding.verdict, finding.found) == (Verdict.FAIL, "CPUs [7] may not be used; usable: [0, 1, 2, 3]")


def test_the_kernels_list_of_cpus() -> None:
    assert computer.cpu_list("") == set()
    assert computer.cpu_list("2-4,7") == {2, 3, 4, 7}


def test_real_time_rights(tmp_path: Path) -> None:
    assert computer.fifo(HandMadeHost(), 40).verdict is Verdict.OK
    assert computer.fifo(HandMadeHost(), 0).verdict is Verdict.WARN
    finding = computer.fifo(HandMadeHost(fifo="Operation not permitted"), 40)
    assert finding.found == "SCHED_FIFO 40 is refused: Operation not permitted"
    assert "LimitRTPRIO=40" in finding.advice
    unbounded = HandMadeHost(files(tmp_path, proc__sys__kernel__sched_rt_runtime_us="-1"))
    assert computer.fifo(unbounded, 40).verdict is Verdict.WARN
    assert computer.memory_lock(HandMadeHost(), is_wanted=True).verdict is Verdict.OK
    assert computer.memory_lock(HandMadeHost(lock="refused"), is_wanted=True).verdict is Verdict.WARN
    assert computer.memory_lock(HandMadeHost(lock="refused"), is_wanted=False).verdict is Verdict.SKIPPED


def test_asking_for_rights_leaves_them_as_they_were() -> None:
    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    Host().fifo_refusal(1)
    Host().memory_lock_refusal()
    assert (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority) == before
    locked = re.search(r"VmLck:\s+(\d+)", Path("/proc/self/status").read_text())
    assert locked is not None
    assert locked.group(1) == "0"


@pytest.mark.parametrize(("gb", "verdict"), [(0.5, Verdict.FAIL), (5.0, Verdict.WARN), (50.0, Verdict.OK)])
def test_disk(gb: float, verdict: Verdict, tmp_path: Path) -> None:
    finding = computer.disk(HandMadeHost(free=int(gb * 1e9)), tmp_path / "not" / "yet" / "there")
    assert finding.verdict is verdict
    assert f"{gb:.1f} GB free" in finding.found


def test_a_folder_that_nobody_may_write_to(tmp_path: Path) -> None:
    finding = computer.disk(HandMadeHost(), tmp_path / "logs")
    assert (finding.verdict, finding.found) == (Verdict.FAIL, f"{tmp_path} is not writable")
    assert Host().free_bytes(tmp_path / "none") is None
    assert (Host().free_bytes(tmp_path) or 0) > 0


def test_policy(tmp_path: Path) -> None:
    assert computer.policy_file(None).verdict is Verdict.SKIPPED
    (tmp_path / "bad.onnx").write_bytes(b"no model")
    result = Check("policy", lambda: computer.policy_file(tmp_path / "bad.onnx")).make()
    assert result.verdict is Verdict.FAIL
    assert "bad.onnx" in result.found
    good = computer.policy_file(REPOSITORY / "policies" / "walk.onnx")
    assert good.verdict is Verdict.OK
    assert "50 Hz" in good.found


def test_a_check_that_breaks_is_a_failure_and_the_error_of_ours_gives_its_advice() -> None:
    def break_down() -> Finding:
        raise ZeroDivisionError("by zero")

    def refuse() -> Finding:
        raise BadInputError("the thing is wrong; mend it")

    broken, refused = Check("a", break_down).make(), Check("b", refuse).make()
    assert (broken.verdict, broken.found) == (Verdict.FAIL, "the check broke: ZeroDivisionError: by zero")
    assert (refused.found, refused.advice) == ("the thing is wrong", "mend it")
    fine = Check("c", lambda: ok("fine")).make()
    assert is_fit([fine])
    assert not is_fit([fine, refused])
    assert line_of(refused) == "fail     b: the thing is wrong; mend it"
    assert line_of(Finding(Verdict.OK, "fine", name="c")) == "ok       c: fine"


def test_all_checks_of_a_computer_have_names_of_their_own() -> None:
    names = [check.name for check in computer.checks_of_computer(HandMadeHost(), RunConfig(), None)]
    assert len(set(names)) == len(names) == 9


def test_latency_and_expiry() -> None:
    assert judge_latency([0.001] * 10, "h", "").verdict is Verdict.OK
    assert judge_latency([0.001] * 9 + [0.02], "h", "").verdict is Verdict.WARN
    assert judge_latency([0.031] * 10, "h", "").verdict is Verdict.FAIL
    day_s = 86400.0
    assert judge_expiry(100 * day_s, 50 * day_s) == ok("trusted, until 1970-04-11")
    assert judge_expiry(100 * day_s, 90 * day_s).verdict is Verdict.WARN


def log(folder: Path, name: str, size_bytes: int, age_s: int) -> Path:
    path = folder / name
    path.write_bytes(bytes(size_bytes))
    os.utime(path, (1e9 - age_s, 1e9 - age_s))
    return path


def test_the_oldest_closed_logs_go_first(tmp_path: Path) -> None:
    for age_s, name in enumerate(
        ("new.mcap", "middle.mcap", "old.mcap", "kept.mcap", "running.mcap.active", "page.html")
    ):
        log(tmp_path, name, 1000, age_s)
    log(tmp_path, "old.mcap.damaged", 1000, 0)
    (tmp_path / "kept.mcap.keep").touch()
    (tmp_path / "link.mcap").symlink_to(tmp_path / "page.html")
    assert [entry.path.name for entry in closed_logs(tmp_path)] == ["old.mcap", "middle.mcap", "new.mcap"]
    prune_logs(tmp_path, quota_gb=2e-6, dry_run=True)
    assert len(closed_logs(tmp_path)) == 3
    prune_logs(tmp_path, quota_gb=2e-6)
    assert [entry.path.name for entry in closed_logs(tmp_path)] == ["middle.mcap", "new.mcap"]
    prune_logs(tmp_path, quota_gb=0.0)
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == ["kept.mcap", "kept.mcap.keep", "link.mcap", "page.html", "running.mcap.active"]


def test_the_quota_by_hand() -> None:
    logs = [LogFile(Path(name), size, i) for i, (name, size) in enumerate((("a", 5), ("b", 3), ("c", 4)))]

    def names(quota: float, missing: float = -100.0) -> str:
        return "".join(entry.path.name for entry in to_delete(logs, quota_bytes=quota, missing_bytes=missing))

    assert names(12) == ""
    assert names(11) == "a"  # 12 of 11: 1 too many
    assert names(6) == "ab"
    assert names(12, missing=6) == "ab"
    assert names(0) == "abc"


def test_a_folder_of_logs_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="is no folder"):
        prune_logs(tmp_path / "none", quota_gb=1.0)


def test_what_a_dead_process_left_behind(tmp_path: Path) -> None:
    assert computer.left_behind(tmp_path / "none").verdict is Verdict.OK
    path = note_path("192.168.50.3:443", tmp_path)
    held = HeldNote.write(path, LeaseNote("192.168.50.3:443", "body", "epoch", 7, "a secret"))
    assert computer.left_behind(tmp_path) == ok("1 in hand now")
    held.let_go()
    finding = computer.left_behind(tmp_path)
    assert finding.verdict is Verdict.WARN
    assert "spot-rl make-safe --robot 192.168.50.3:443" in finding.advice
    assert "secret" not in str(finding)
    path.write_text("{")
    assert computer.left_behind(tmp_path).verdict is Verdict.WARN  # a service may start all the same
