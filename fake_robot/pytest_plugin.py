"""A fake Spot in the tests of any SDK user: ``def test_mine(fake_spot): robot = fake_spot.sdk_robot() ...``.

Installed as a pytest plug-in. The robot runs in a process of its own and ends with the test, however that ends.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

START_TIMEOUT_S = 60.0
STOP_TIMEOUT_S = 10.0


class FakeSpotError(Exception):
    """The fake robot's process did not come up, or did not end; the message holds what it said."""


@dataclasses.dataclass(frozen=True)
class FakeSpot:
    """A running fake robot, and all that a program needs to reach it."""

    host: str
    """What an SDK program takes as the robot's host name."""
    port: int
    """TCP port on 127.0.0.1."""
    username: str
    password: str = dataclasses.field(repr=False)
    ca_path: Path
    """Certificate authority to trust: ``create_standard_sdk(..., cert_resource_glob=str(ca_path))``."""
    admin_target: str
    """gRPC target of the admin service (lock-step, faults, truth); it needs no TLS and no token."""
    environment: Mapping[str, str] = dataclasses.field(repr=False)
    """Variables with which an unmodified program, started as a process, trusts and opens the fake."""

    def sdk_robot(self, *service_clients: type, client_name: str = "test", is_authenticated: bool = True) -> Any:
        """A ``bosdyn.client.robot.Robot``, logged in.

        Args:
            service_clients: Client classes to register beside the SDK's defaults, say ``RobotStateStreamingClient``.
            client_name: Name under which the client appears at the robot.
            is_authenticated: Whether to log in.
        """
        from bosdyn.client.sdk import create_standard_sdk

        sdk = create_standard_sdk(client_name, list(service_clients), cert_resource_glob=str(self.ca_path))
        robot = sdk.create_robot(self.host)
        if is_authenticated:
            robot.authenticate(self.username, self.password)
        return robot

    @contextlib.contextmanager
    def admin(self) -> Iterator[Any]:
        """A stub of the admin service: ``with fake_spot.admin() as admin: admin.GetTruth(...)``."""
        import grpc

        from spot_protos import fake_admin_pb2_grpc

        with grpc.insecure_channel(self.admin_target) as channel:
            yield fake_admin_pb2_grpc.FakeAdminStub(channel)  # type: ignore[no-untyped-call]

    def run_program(self, words: Sequence[str], *, timeout_s: float = 120.0) -> subprocess.CompletedProcess[str]:
        """Run an unmodified program against this robot; every word ``HOST`` becomes the host argument.

        Raises:
            subprocess.TimeoutExpired: It did not end in time; it has been killed.
        """
        return subprocess.run(  # noqa: S603 - the test's own program
            [self.host if word == "HOST" else word for word in words],
            env={**os.environ, **self.environment},
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )


@contextlib.contextmanager
def running_fake_spot(
    *, scenario: str | Path | Mapping[str, Any] | None = None, lock_step: bool = False, state_folder: Path | None = None
) -> Iterator[FakeSpot]:
    """Run a fake robot in a process of its own while the block runs.

    Args:
        scenario: A scenario file, the name of a shipped one, or the keys of one.
        lock_step: Robot time passes only by the admin service.
        state_folder: Where certificates and password are kept; a temporary folder if None.

    Raises:
        FakeSpotError: It did not come up.
    """
    with tempfile.TemporaryDirectory(prefix="spot-rl-") as temporary:
        folder = Path(temporary)
        words = [sys.executable, "-m", "fake_robot", "--port", "0", "--json", "--until-stdin-closes"]
        words += ["--state-dir", str(state_folder or folder / "state"), "--ready-file", str(folder / "ready.json")]
        words += ["--lock-step"] if lock_step else []
        words += ["--scenario", str(_scenario_file(scenario, folder))] if scenario is not None else []
        with (folder / "log").open("wb") as log:
            process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=log)  # noqa: S603
        try:
            yield _wait_until_ready(process, folder)
        finally:
            _end(process)


@pytest.fixture(scope="session")
def fake_spot_state_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the fakes of this session keep their certificates and password."""
    return tmp_path_factory.mktemp("fake-spot")


@pytest.fixture
def fake_spot(fake_spot_state_folder: Path) -> Iterator[FakeSpot]:
    """A fake Spot with the default scenario, sitting with its motors off, in real time."""
    with running_fake_spot(state_folder=fake_spot_state_folder) as spot:
        yield spot


@pytest.fixture
def fake_spot_factory(fake_spot_state_folder: Path) -> Iterator[Callable[..., FakeSpot]]:
    """Start as many fake Spots as the test wants; keywords as of ``running_fake_spot``."""
    with contextlib.ExitStack() as stack:

        def start(**keywords: Any) -> FakeSpot:
            return stack.enter_context(running_fake_spot(state_folder=fake_spot_state_folder, **keywords))

        yield start


def _scenario_file(scenario: str | Path | Mapping[str, Any], folder: Path) -> str | Path:
    if not isinstance(scenario, Mapping):
        return scenario
    path = folder / "scenario.yaml"
    path.write_text(json.dumps(dict(scenario)))  # JSON is YAML
    return path


def _wait_until_ready(process: subprocess.Popen[bytes], folder: Path) -> FakeSpot:
    deadline_s = time.monotonic() + START_TIMEOUT_S
    ready = folder / "ready.json"
    while not ready.exists():
        if process.poll() is not None or time.monotonic() > deadline_s:
            said = (folder / "log").read_text(errors="replace").strip()
            how = "did not come up" if process.returncode is None else f"ended with code {process.returncode}"
            raise FakeSpotError(f"the fake robot {how}; it said: {said or 'nothing'}")
        time.sleep(0.02)
    told = json.loads(ready.read_text())
    return FakeSpot(
        host=told["sdk_host"],
        port=told["port"],
        username=told["username"],
        password=told["password"],
        ca_path=Path(told["ca_file"]),
        admin_target=told["admin"],
        environment=told["environment"],
    )


def _end(process: subprocess.Popen[bytes]) -> None:
    """Ask it to end; kill it if it will not."""
    if process.stdin is not None:
        with contextlib.suppress(BrokenPipeError):
            process.stdin.close()
    process.terminate()
    try:
        process.wait(STOP_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
