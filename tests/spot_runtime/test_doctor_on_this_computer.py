"""The doctor's checks of the computer, on computers made by hand; the quota of the logs."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import tomllib

from spot_log.tools.retention import LogFile, closed_logs, prune_logs, to_delete
from spot_model.errors import BadInputError
from spot_runtime.config import RunConfig
from spot_runtime.rescue.lease_note import HeldNote, LeaseNote, note_path
from spot_tools import computer_checks as computer
from spot_tools.checks import CheckResult, DoctorCheck, Finding, is_fit, ok
from spot_tools.computer_checks import Host
from spot_tools.doctor import line_of
from spot_tools.robot_checks import judge_expiry, judge_latency

REPOSITORY = Path(__file__).resolve().parents[2]


class HandMadeHost(Host):
    """A computer whose every answer the test gives; the rest is as on a computer that is fit."""

    def __init__(self, root: Path = Path("/nowhere"), **answers: Any) -> None:
        super().__init__(root)
        self._answers = {"python": (3, 10, 12), "machine": "aarch64", "packages": [], "installed": {}, **answers}

    def python_version(self) -> Any:
        return self._answers["python"]

    def machine(self) -> Any:
        return self._answers["machine"]

    def requirements(self, package: str) -> Any:
        return self._answers["packages"]

    def installed_version(self, package: str) -> Any:
        return self._answers["installed"].get(package)

    def fifo_refusal(self, priority: int) -> Any:
        return self._answers.get("fifo", "")

    def memory_lock_refusal(self) -> Any:
        return self._answers.get("lock", "")

    def free_bytes(self, folder: Path) -> Any:
        return self._answers.get("free")

    def note_folder(self) -> Path:
        return Path("/nowhere")

    def usable_cpus(self) -> set[int]:
        return {0, 1, 2, 3}


PINS = [
    "typer==0.29.1",
    'numpy==2.2.6; python_version < "3.11" and extra == "runtime"',
    'numpy==2.4.6; python_version >= "3.11" and extra == "runtime"',
    'torch==2.13.0; extra == "train"',
]
GOVERNOR = "sys/devices/system/cpu/cpu{}/cpufreq/scaling_governor"
ISOLATED = {"sys/devices/system/cpu/isolated": "2-3"}
UNBOUNDED = {"proc/sys/kernel/sched_rt_runtime_us": "-1"}
REFUSED = "Operation not permitted"


def host(files: dict[str, str] | None = None, **answers: Any) -> Callable[[Path], HandMadeHost]:
    """A computer with these files."""

    def make(root: Path) -> HandMadeHost:
        for name, content in (files or {}).items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(content + "\n")
        return HandMadeHost(root, **answers)

    return make


def packages(**installed: str) -> Callable[[Path], HandMadeHost]:
    return host(packages=PINS, installed=installed)


def governors(*names: str) -> Callable[[Path], HandMadeHost]:
    return host({GOVERNOR.format(i): name for i, name in enumerate(names)})


CASES: list[tuple[str, tuple[Any, ...], Callable[[Path], HandMadeHost], str, str]] = [
    ("python", (), host(python=(3, 9, 2)), "fail", "Python 3.9.2 on aarch64; install Python 3.10"),
    ("python", (), host(), "ok", "Python 3.10.12 on aarch64"),
    ("python", (), host(python=(3, 12, 3), machine="x86_64"), "ok", ""),
    ("python", (), host(python=(3, 13, 0)), "warn", "3.10 to 3.12"),
    ("python", (), host(machine="armv7l"), "warn", "x86_64 and aarch64 only"),
    ("packages", (), packages(typer="0.29.1", numpy="2.2.6"), "ok", "2 packages"),
    ("packages", (), packages(typer="0.29.1", numpy="2.4.6"), "ok", ""),
    ("packages", (), packages(typer="0.29.1"), "fail", "missing: numpy"),
    ("packages", (), packages(typer="0.29.1", numpy="2.0.0"), "warn", "numpy 2.0.0 (made for 2.2.6 or 2.4.6)"),
    ("packages", (), host(), "fail", "not installed"),
    ("cpu_governor", (), host(), "skipped", "no frequency governors"),
    ("cpu_governor", (), governors("performance", "schedutil"), "warn", "schedutil on some of 2 CPUs"),
    ("cpu_governor", (), governors("performance", "performance"), "ok", "all 2 CPUs"),
    ("cpu_isolation", ((),), host(ISOLATED), "skipped", ""),
    ("cpu_isolation", ((2, 3),), host(ISOLATED), "ok", ""),
    ("cpu_isolation", ((1, 2),), host(ISOLATED), "warn", "add isolcpus=1 to the kernel's command line"),
    ("cpu_isolation", ((2, 7),), host(ISOLATED), "fail", "CPUs [7] may not be used; usable: [0, 1, 2, 3]"),
    ("fifo", (40,), host(), "ok", ""),
    ("fifo", (0,), host(), "warn", "is 0"),
    (
        "fifo",
        (40,),
        host(fifo=REFUSED),
        "warn",
        f"SCHED_FIFO 40 is refused: {REFUSED}; run as the service (LimitRTPRIO=40",
    ),
    ("fifo", (40,), host(UNBOUNDED), "warn", "bounds no real-time process"),
    ("memory_lock", (True,), host(), "ok", ""),
    ("memory_lock", (True,), host(lock=REFUSED), "warn", REFUSED),
    ("memory_lock", (False,), host(lock=REFUSED), "skipped", ""),
    ("disk", (Path("/not/yet/there"),), host(free=500_000_000), "fail", "0.5 GB free"),
    ("disk", (Path("/not/yet/there"),), host(free=5_000_000_000), "warn", "5.0 GB free"),
    ("disk", (Path("/not/yet/there"),), host(free=50_000_000_000), "ok", "50.0 GB free under /not/yet/there"),
    ("disk", (Path("/not/yet/there"),), host(), "fail", "/ is not writable"),
]


@pytest.mark.parametrize(("check", "given", "make", "verdict", "words"), CASES)
def test_a_computer(
    check: str, given: tuple[Any, ...], make: Callable[[Path], HandMadeHost], verdict: str, words: str, tmp_path: Path
) -> None:
    names = {"is_wanted": given[0]} if check == "memory_lock" else {}
    finding = getattr(computer, check)(make(tmp_path), *(() if names else given), **names)
    assert finding.verdict.value == verdict
    assert words in f"{finding.found}; {finding.advice}"


def test_every_check_of_a_computer_has_a_case() -> None:
    checks = [check.name for check in computer.checks_of_computer(HandMadeHost(), RunConfig(), None)]
    apart = ["policy", "left behind"]
    assert len(set(checks)) == len(checks) == len({case[0] for case in CASES}) + len(apart)


def test_the_pins_are_those_of_the_project() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    stated = {re.split("==", line)[0] for line in project["dependencies"] + project["optional-dependencies"]["runtime"]}
    assert set(computer.runtime_pins(Host().requirements("spot-rl"))) == stated


def test_the_kernels_list_of_cpus() -> None:
    assert computer.cpu_list("") == set()
    assert computer.cpu_list("2-4,7") == {2, 3, 4, 7}


def test_asking_leaves_a_computer_as_it_was(tmp_path: Path) -> None:
    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    Host().fifo_refusal(1)
    Host().memory_lock_refusal()
    assert (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority) == before
    locked = re.search(r"VmLck:\s+(\d+)", Path("/proc/self/status").read_text())
    assert locked is not None
    assert locked.group(1) == "0"
    assert Host().free_bytes(tmp_path / "none") is None
    assert (Host().free_bytes(tmp_path) or 0) > 0


def test_policy(tmp_path: Path) -> None:
    assert computer.policy_file(None).verdict is CheckResult.SKIPPED
    (tmp_path / "bad.onnx").write_bytes(b"no model")
    result = DoctorCheck("policy", lambda: computer.policy_file(tmp_path / "bad.onnx")).make()
    assert result.verdict is CheckResult.FAIL
    assert "bad.onnx" in result.found
    good = computer.policy_file(REPOSITORY / "policies" / "walk.onnx")
    assert good.verdict is CheckResult.OK
    assert "50 Hz" in good.found


def test_a_check_that_breaks_is_a_failure_and_the_error_of_ours_gives_its_advice() -> None:
    def break_down() -> Finding:
        raise ZeroDivisionError("by zero")

    def refuse() -> Finding:
        raise BadInputError("the thing is wrong; mend it")

    broken, refused = DoctorCheck("a", break_down).make(), DoctorCheck("b", refuse).make()
    assert (broken.verdict, broken.found) == (CheckResult.FAIL, "the check broke: ZeroDivisionError: by zero")
    assert (refused.found, refused.advice) == ("the thing is wrong", "mend it")
    fine = DoctorCheck("c", lambda: ok("fine")).make()
    assert is_fit([fine])
    assert not is_fit([fine, refused])
    assert line_of(refused) == "fail     b: the thing is wrong; mend it"
    assert line_of(Finding(CheckResult.OK, "fine", name="c")) == "ok       c: fine"


def test_latency_and_expiry() -> None:
    assert judge_latency([0.001] * 10, "h", "").verdict is CheckResult.OK
    assert judge_latency([0.001] * 9 + [0.02], "h", "").verdict is CheckResult.WARN
    assert judge_latency([0.031] * 10, "h", "").verdict is CheckResult.FAIL
    day_s = 86400.0
    assert judge_expiry(100 * day_s, 50 * day_s) == ok("trusted, until 1970-04-11")
    assert judge_expiry(100 * day_s, 90 * day_s).verdict is CheckResult.WARN


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
    assert computer.left_behind(tmp_path / "none").verdict is CheckResult.OK
    path = note_path("192.168.50.3:443", tmp_path)
    held = HeldNote.write(path, LeaseNote("192.168.50.3:443", "body", "epoch", 7, "a secret"))
    assert computer.left_behind(tmp_path) == ok("1 in hand now")
    held.let_go()
    finding = computer.left_behind(tmp_path)
    assert finding.verdict is CheckResult.WARN
    assert "spot-rl make-safe --robot 192.168.50.3:443" in finding.advice
    assert "secret" not in str(finding)
    path.write_text("{")
    assert computer.left_behind(tmp_path).verdict is CheckResult.WARN  # a service may start all the same
