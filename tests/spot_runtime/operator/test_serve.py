"""``spot-rl serve`` and ``spot-rl ctl`` as processes, on the fake robot in lock-step, and what killing them does."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fake_robot.start.process import FakeAddress
from spot_log import read_run
from spot_protos import fake_admin_pb2, operator_pb2
from spot_tools.client import OperatorClient, RefusedError

from .conftest import POLICIES, wait_until

SPOT_RL = [str(Path(sys.executable).with_name("spot-rl"))]
CONFIG = """
schema: spot-rl/run/1
handover: {ramp_in_s: 1.0}
service: {attendance_s: 600.0, deadman_s: 2.0}
"""


class Service:
    """A running ``spot-rl serve``, and its service manager."""

    def __init__(self, folder: Path, address: FakeAddress, *, is_lock_step: bool = True) -> None:
        self.folder, self.logs = folder, folder / "logs"
        self.manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.manager.bind(str(folder / "notify"))
        (folder / "run.yaml").write_text(CONFIG)
        self.socket = f"unix:{folder}/operator.sock"
        self.environment = {
            **os.environ,
            **address.environment,
            "NOTIFY_SOCKET": str(folder / "notify"),
            "WATCHDOG_USEC": "2000000",
            "SPOT_RL_OPERATOR": self.socket,
            "XDG_STATE_HOME": str(folder),
        }
        self._address = address
        self._pace = ["--lock-step", address.admin] if is_lock_step else []
        self.said: list[str] = []
        threading.Thread(target=self._listen, daemon=True).start()
        self.start()

    def start(self) -> None:
        """Start it, and wait until it is ready."""
        address, folder = self._address, self.folder
        words = ["serve", "--robot", address.robot, "--policies", str(POLICIES), "--listen", self.socket]
        words += ["--config", str(folder / "run.yaml"), "--log-dir", str(self.logs), *self._pace]
        self.process = subprocess.Popen([*SPOT_RL, *words], env=self.environment, stderr=subprocess.PIPE)
        self.said.clear()
        self.hear("READY=1")

    def _listen(self) -> None:
        """Read as a service manager does, all the time: its queue is short, and what finds no room is lost."""
        with contextlib.suppress(OSError):  # the socket is closed
            while data := self.manager.recv(4096):
                self.said.append(data.decode())

    def hear(self, word: str) -> None:
        """Wait until the service has told its manager this."""

        def is_said() -> bool:
            if self.process.poll() not in (None, 0):
                pytest.fail(f"the service ended: {self.process.communicate()[1].decode()}")
            return word in self.said

        wait_until(is_said, f"{word} is told")

    def ctl(self, *words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*SPOT_RL, "ctl", *words], env=self.environment, capture_output=True, text=True, check=False, timeout=120.0
        )

    def status(self) -> operator_pb2.Status:
        with OperatorClient(self.socket) as client:
            status: operator_pb2.Status = client.call("GetStatus", operator_pb2.GetStatusRequest())
            return status

    def wait_for(self, *, state: str = "", mode: str = "") -> operator_pb2.Status:
        for _ in range(2400):
            status = self.status()
            if (not state or status.state == state) and (not mode or status.run.mode == mode):
                return status
            time.sleep(0.05)
        pytest.fail(f"never {state or mode}: {status}")

    def control_pid(self) -> int:
        return child_of(self.process.pid, "run_child")

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.terminate()
        self.process.communicate(timeout=60.0)
        self.manager.shutdown(socket.SHUT_RD)
        self.manager.close()


@pytest.fixture
def service(tmp_path: Path, fake: FakeAddress) -> Iterator[Service]:
    started = Service(tmp_path, fake)
    yield started
    started.end()


def child_of(pid: int, module: str) -> int:
    """The one child of a process that runs this module."""
    children = [c for task in Path(f"/proc/{pid}/task").iterdir() for c in text_of(task / "children").split()]
    (found,) = {int(c) for c in children if module in text_of(Path(f"/proc/{c}/cmdline"))}
    return found


def text_of(file: Path) -> str:
    """What a file of /proc says; nothing where its thread or process has just ended."""
    try:
        return file.read_text()
    except OSError:
        return ""


def is_alive(pid: int) -> bool:
    try:
        return bool(Path(f"/proc/{pid}/cmdline").read_bytes())
    except OSError:
        return False


def at_rest(admin: Any) -> bool:
    status = admin.GetStatus(fake_admin_pb2.GetStatusRequest())
    return status.motor_power.lower().endswith("off") and not status.lease_owner


def test_a_walk_by_command_line(service: Service, admin: Any) -> None:
    assert json.loads(service.ctl("status", "--json").stdout)["state"] == "idle"
    assert at_rest(admin)
    armed = service.ctl("arm", "walk", "--label", "surface=lab", "--operator", "tester")
    assert armed.returncode == 0, armed.stderr
    assert "stands under the vendor's control" in armed.stdout
    assert service.ctl("start").returncode == 0
    service.wait_for(mode="active")
    steered = service.ctl("velocity", "0.3", "--for", "0.5")
    assert steered.returncode == 0, steered.stderr
    stopped = service.ctl("stop", "--wait")
    assert "stopping in place" in stopped.stdout
    assert "idle; the operator asked to stop" in stopped.stdout
    assert at_rest(admin)
    (path,) = service.logs.glob("*.mcap")
    log = read_run(path)
    assert (log.outcome, log.header.labels) == ("operator_stop", {"surface": "lab", "operator": "tester"})
    assert max(log.ticks.velocity_command[:, 0]) > 0.05
    assert "service_arming: policy walk, asked by tester" in service.ctl("events", "--past", "100").stdout
    service.process.terminate()
    _, errors = service.process.communicate(timeout=60.0)
    assert service.process.returncode == 0, errors
    service.hear("STOPPING=1")
    assert "WATCHDOG=1" in service.said


def test_a_service_that_is_killed_leaves_the_robot_at_rest(service: Service, admin: Any) -> None:
    service.ctl("arm", "walk")
    service.ctl("start")
    service.wait_for(mode="active")
    pid = service.control_pid()
    service.process.kill()
    service.process.wait()
    wait_until(lambda: not is_alive(pid), "the control process ends")
    assert at_rest(admin)
    assert not admin.GetTruth(fake_admin_pb2.GetTruthRequest()).has_fallen
    (path,) = service.logs.glob("*.mcap")
    assert read_run(path).outcome == "service_lost"


def test_sigterm_while_walking_sits_down_first(service: Service, admin: Any) -> None:
    service.ctl("arm", "walk")
    service.ctl("start")
    service.wait_for(mode="active")
    service.process.terminate()
    service.process.communicate(timeout=60.0)
    assert service.process.returncode == 0
    assert at_rest(admin)


def test_a_control_process_that_dies_is_told_of_and_the_service_is_idle_again(service: Service, admin: Any) -> None:
    service.ctl("arm", "walk")
    os.kill(service.control_pid(), signal.SIGKILL)
    status = service.wait_for(state="idle")
    assert status.last.outcome == "control_process_died"
    assert "signal SIGKILL" in status.last.sentence
    assert "it sat down and its motors lost power" in status.last.sentence
    assert at_rest(admin)
    assert "service_made_safe" in service.ctl("events", "--past", "100").stdout
    with OperatorClient(service.socket) as client, pytest.raises(RefusedError, match="needs the state armed"):
        client.call("Start", operator_pb2.StartRequest())


def test_a_control_process_that_hangs_is_killed_and_the_robot_made_safe(service: Service, admin: Any) -> None:
    service.ctl("arm", "walk")
    service.ctl("start")
    service.wait_for(mode="active")
    os.kill(service.control_pid(), signal.SIGSTOP)  # it sees no signal but one
    status = service.wait_for(state="idle")
    assert status.last.outcome == "control_process_died"
    assert "signal SIGKILL" in status.last.sentence
    assert at_rest(admin)
    told = service.ctl("events", "--past", "100").stdout
    assert "has said nothing for" in told
    assert "service_made_safe" in told


def test_when_all_processes_die_the_next_start_makes_the_robot_safe_first(service: Service, admin: Any) -> None:
    service.ctl("arm", "walk")
    service.ctl("start")
    service.wait_for(mode="active")
    control = service.control_pid()
    all_processes = (child_of(control, "guardian"), control, service.process.pid)
    for how in (signal.SIGSTOP, signal.SIGKILL):  # stopped first, or the last one would see the others die and act
        for pid in all_processes:
            os.kill(pid, how)
    service.process.communicate()
    assert not at_rest(admin)
    service.start()
    service.wait_for(state="idle")
    assert at_rest(admin)
    assert "service_made_safe" in service.ctl("events", "--past", "100").stdout


def test_when_service_and_control_die_whoever_is_left_makes_the_robot_safe(service: Service, admin: Any) -> None:
    service.ctl("arm", "walk")
    service.ctl("start")
    service.wait_for(mode="active")
    control = service.control_pid()
    guardian = child_of(control, "guardian")
    os.kill(control, signal.SIGSTOP)
    service.process.kill()
    os.kill(control, signal.SIGKILL)
    service.process.communicate()
    wait_until(lambda: not is_alive(guardian), "the guardian has done its work")
    assert at_rest(admin)
    assert not list(service.folder.glob("spot-rl/lease-*"))


def test_a_run_from_the_command_line_that_is_killed_leaves_no_power(
    tmp_path: Path, fake: FakeAddress, admin: Any
) -> None:
    words = ["run", "--robot", fake.robot, "--policy", str(POLICIES / "walk.onnx"), "--duration", "600"]
    words += ["--log-dir", str(tmp_path), "--lock-step", fake.admin, "--sequence", "forward"]
    environment = {**os.environ, **fake.environment, "XDG_STATE_HOME": str(tmp_path)}
    with subprocess.Popen([*SPOT_RL, *words], env=environment, stderr=subprocess.DEVNULL) as run:
        wait_until(lambda: "joint_control" in mode_of(admin) or run.poll() is not None, "the robot walks")
        guardian = child_of(run.pid, "guardian")
        run.kill()
    wait_until(lambda: not is_alive(guardian), "the guardian has done its work")
    assert at_rest(admin)


def mode_of(admin: Any) -> str:
    return str(admin.GetStatus(fake_admin_pb2.GetStatusRequest()).mode).lower()


def test_a_service_without_policies_does_not_start(tmp_path: Path) -> None:
    words = ["serve", "--robot", "127.0.0.1:1", "--policies", str(tmp_path / "none")]
    told = subprocess.run([*SPOT_RL, *words], capture_output=True, text=True, check=False)
    assert told.returncode == 2
    assert "there is no folder" in told.stderr
