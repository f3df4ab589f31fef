"""A fake Spot in the tests of any SDK user: ``def test_mine(fake_spot): robot = fake_spot.sdk_robot() ...``.

Installed as a pytest plug-in. The robot runs in a process of its own and ends with the test, however that ends.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from fake_robot.start.process import FakeProcess


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
        """A ``bosdyn.client.robot.Robot``, logged in unless told otherwise, under this client's name.

        The client classes, say ``RobotStateStreamingClient``, are registered beside the SDK's defaults.
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

        from spot_protos import fake_admin_pb2
        from spot_protos.stub import stub

        with grpc.insecure_channel(self.admin_target) as channel:
            yield stub(channel, fake_admin_pb2)

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

    ``scenario`` is a file, the name of a shipped one, or the keys of one; in lock-step, robot time advances only by
    the admin service. Without a ``state_folder``, a user's certificates and password are kept in one.

    Raises:
        FakeProcessError: It did not come up; the message holds what it said.
    """
    process = FakeProcess(
        scenario="default" if scenario is None else scenario,
        is_lock_step=lock_step,
        state_dir=state_folder,
        is_silent=True,
    )
    with process:
        ready = process.ready
        yield FakeSpot(
            host=ready["sdk_host"],
            port=ready["port"],
            username=ready["username"],
            password=ready["password"],
            ca_path=Path(ready["ca_file"]),
            admin_target=ready["admin"],
            environment=ready["environment"],
        )


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
