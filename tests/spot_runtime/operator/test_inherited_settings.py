"""A run and a service whose parent blocked and ignored all signals, in a folder full of other modules: each still
stops by every signal, and no process of theirs holds a password in its environment."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest

from fake_robot.start.process import FakeAddress
from spot_model.process.signals import STOP_SIGNALS
from tests.spot_model.test_inherited import DEAF, SPOT_RL, loaded_first, marks, planted

from . import test_serve
from .conftest import POLICIES, wait_until
from .test_serve import Service, at_rest, child_of, mode_of

RELATIVE = f"{os.pathsep}/nowhere{os.pathsep}."
"""Leads to the current folder, twice."""


def signals_of(pid: int, kind: str) -> set[int]:
    """Those of a process: ``SigBlk``, ``SigIgn`` or ``SigCgt``."""
    line = next(line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith(kind))
    mask = int(line.split()[1], 16)
    return {number for number in STOP_SIGNALS if mask >> number - 1 & 1}


@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGTERM, 10), (signal.SIGINT, 10), (signal.SIGHUP, 10), (signal.SIGQUIT, 12)],
)
def test_a_run_hears_every_signal(
    number: signal.Signals, code: int, fake: FakeAddress, admin: Any, tmp_path: Path
) -> None:
    folder = planted(tmp_path / "here", but=loaded_first())
    words = [SPOT_RL, "run", "--robot", fake.robot, "--policy", str(POLICIES / "walk.onnx"), "--duration", "600"]
    words += ["--lock-step", fake.admin, "--log-dir", str(tmp_path / "logs")]
    environment = {**os.environ, **fake.environment, "XDG_STATE_HOME": str(tmp_path), "PYTHONPATH": RELATIVE}
    with subprocess.Popen([*DEAF, *words], env=environment, cwd=folder, stderr=subprocess.DEVNULL) as run:
        wait_until(lambda: "joint_control" in mode_of(admin) or run.poll() is not None, "the robot walks")
        for name in ("logger_child", "rescue.guardian"):
            child = child_of(run.pid, name)
            assert not signals_of(child, "SigBlk"), name
            assert fake.environment["BOSDYN_CLIENT_PASSWORD"] not in Path(f"/proc/{child}/environ").read_text(), name
        run.send_signal(number)
        assert run.wait(120.0) == code
    wait_until(lambda: at_rest(admin), "the robot is at rest")
    assert marks(folder) == ""


def test_a_service_and_its_control_process_hear_every_signal(
    fake: FakeAddress, admin: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(planted(tmp_path / "here", but=loaded_first()))
    monkeypatch.setattr(test_serve, "SPOT_RL", [*DEAF, SPOT_RL])
    monkeypatch.setitem(fake.environment, "PYTHONPATH", RELATIVE)
    service = Service(tmp_path, fake)
    try:
        assert service.ctl("arm", "walk").returncode == 0
        control = service.control_pid()
        for pid in (service.process.pid, control):
            assert not signals_of(pid, "SigBlk")
            assert signals_of(pid, "SigCgt") == set(STOP_SIGNALS)
        assert fake.environment["BOSDYN_CLIENT_PASSWORD"] not in Path(f"/proc/{control}/environ").read_text()
        service.process.send_signal(signal.SIGQUIT)
        assert service.process.wait(120.0) == 0
        assert service.process.stderr is not None
        assert "operator_estop" in service.process.stderr.read().decode()
    finally:
        service.end()
    wait_until(lambda: at_rest(admin), "the robot is at rest")
    assert marks(tmp_path / "here") == ""
