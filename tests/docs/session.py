"""Plays the terminal sessions of a page: against a fake robot in lock-step in the place of the robot that it names."""

from __future__ import annotations

import os
import pty
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import TracebackType

import grpc
from typing_extensions import Self

from fake_robot.start.process import FakeProcess
from spot_protos import fake_admin_pb2
from spot_protos.stub import stub as stub_of

from .blocks import REPOSITORY

PROGRAMS = Path(sys.executable).parent
ADDRESSES = ("192.168.50.3", "127.0.0.1:8443")
CONFIG = """\
schema: spot-rl/run/1
# Robot time waits for nobody in lock-step, but runs on between two commands of a page.
handover: {ramp_in_s: 1.0}
service: {attendance_s: 600.0, deadman_s: 2.0}
"""
SCREENS = ("watch", "drive", "--follow")
"""Words of a command that goes on until somebody ends it."""

SHOWN_S = 0.5
ENDED_BY_SIGNAL = (0, 1, 130, -signal.SIGINT)


class Session:
    """One page's commands, in order, each of which must succeed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir()
        self._fake = FakeProcess(is_lock_step=True, state_dir=folder / "fake")
        # A socket's name is short, and the folders of tests may lie deep.
        self._runtime = Path(tempfile.mkdtemp(prefix="pages-", dir="/tmp"))
        self._service: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        self._fake.__enter__()
        address = self._fake.address
        user, password = (address.environment[f"BOSDYN_CLIENT_{name}"] for name in ("USERNAME", "PASSWORD"))
        credentials = self.folder / "credentials.yaml"
        credentials.write_text(f"username: {user}\npassword: {password}\n")
        credentials.chmod(0o600)
        (self.folder / "run.yaml").write_text(CONFIG)
        (self.folder / "walk.onnx").symlink_to(REPOSITORY / "policies" / "walk.onnx")
        (self.folder / "ca.pem").symlink_to(address.environment["SPOT_RL_CA_FILE"])
        self.environment = {
            **os.environ,
            **address.environment,
            "PATH": f"{PROGRAMS}:{os.environ['PATH']}",
            "HOME": str(self.folder),
            "XDG_RUNTIME_DIR": str(self._runtime),
            "TERM": "xterm",
        }
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._service is not None:
            self._service.terminate()
            self._service.communicate(timeout=60.0)
        self._fake.stop()
        shutil.rmtree(self._runtime)

    def play(self, line: str) -> None:
        """Run one command line as it stands, but for the robot's address and the log's name."""
        for address in ADDRESSES:
            line = line.replace(address, self._fake.address.robot)
        line = self._name_log(line)
        words = shlex.split(line, comments=True)
        if words[:2] == ["spot-rl", "serve"]:
            self._serve(words)
        elif "--gamepad" in words:
            told = self._run(words)
            assert "gamepad 0 is not attached" in told.stderr, told.stderr  # none is; tests play on one of SDL's own
        elif set(words) & set(SCREENS):
            self._show(words)
        else:
            told = self._run(["bash", "-euo", "pipefail", "-c", line])
            assert told.returncode == 0, f"{line}\n{told.stdout}{told.stderr}"

    def is_at_rest(self) -> bool:
        """Whether the robot has neither power nor a holder."""
        with grpc.insecure_channel(self._fake.address.admin) as channel:
            stub = stub_of(channel, fake_admin_pb2)
            status = stub.GetStatus(fake_admin_pb2.GetStatusRequest())
        return status.motor_power.lower().endswith("off") and not status.lease_owner

    def _name_log(self, line: str) -> str:
        logs = sorted((self.folder / "logs").glob("2*.mcap"))
        if "LOG.mcap" not in line or not logs:
            return line
        if "LOG.mcap.active" in line:
            shutil.copy(logs[-1], self.folder / "logs" / "LOG.mcap.active")
            return line
        return line.replace("LOG.mcap", logs[-1].name)

    def _serve(self, words: list[str]) -> None:
        if self._service is not None:
            return  # the page starts it once more in passing
        more = ["--lock-step", self._fake.address.admin, "--config", "run.yaml"]
        self._service = subprocess.Popen(
            [*words, *more], cwd=self.folder, env=self.environment, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL
        )
        while not (self._runtime / "spot-rl" / "operator.sock").exists():
            assert self._service.poll() is None, self._service.communicate()[1].decode()
            time.sleep(0.1)

    def _show(self, words: list[str]) -> None:
        """In a terminal of its own, for as long as it takes to draw; then Ctrl-C."""
        ours, theirs = pty.openpty()
        with subprocess.Popen(
            words, cwd=self.folder, env=self.environment, stdin=theirs, stdout=theirs, stderr=theirs, process_group=0
        ) as process:
            os.close(theirs)
            shown = os.read(ours, 65536)
            time.sleep(SHOWN_S)
            process.send_signal(signal.SIGINT)
            while True:
                try:
                    if not (chunk := os.read(ours, 65536)):
                        break
                except OSError:
                    break
                shown += chunk
            code = process.wait()
        os.close(ours)
        assert code in ENDED_BY_SIGNAL, f"{words}: {code}: {shown.decode(errors='replace')}"
        assert b"ctl: error" not in shown, shown.decode(errors="replace")

    def _run(self, words: list[str]) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            words,
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
            check=False,
            stdin=subprocess.DEVNULL,
        )
