"""Lock-step on a computer that stands still for a while."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import grpc
import pytest

from fake_robot.services.calls import RefusedCallError, Service, UnaryCalls
from fake_robot.services.stepping import StepSocket
from spot_protos import fake_admin_pb2
from spot_runtime.hal.errors import LockStepError
from spot_runtime.hal.spot.lock_step import COMMAND_ATTEMPTS, LockStep


class Admin(Service):
    """Answers steps, but says for a while that the command that is waited for has not come."""

    modules = (fake_admin_pb2,)

    def __init__(self) -> None:
        super().__init__()
        self.deaf_to = 0
        self.waited_for: list[int] = []
        self.step_socket = StepSocket(self.step)

    def GetStatus(self, request: Any, response: Any) -> None:  # noqa: N802
        response.lock_step, response.robot_stamp_ns = True, 1_000
        response.step_socket = self.step_socket.path

    def step(self, request: Any, response: Any) -> None:
        self.waited_for.append(request.wait_for_command_key)
        if request.wait_for_command_key and self.deaf_to:
            self.deaf_to -= 1
            raise RefusedCallError(grpc.StatusCode.DEADLINE_EXCEEDED, "no command")
        response.elapsed_ns, response.robot_stamp_ns = 3_000_000, 3_001_000


@pytest.fixture
def admin() -> Iterator[tuple[Admin, LockStep]]:
    servicer, server = Admin(), grpc.server(ThreadPoolExecutor(1))
    server.add_generic_rpc_handlers((UnaryCalls([servicer]),))
    port = server.add_insecure_port("127.0.0.1:0")
    server.start()
    pace = LockStep(f"127.0.0.1:{port}", 0)
    yield servicer, pace
    pace.stop()
    servicer.step_socket.close()
    server.stop(None).wait()


@pytest.mark.parametrize("waits", [1, COMMAND_ATTEMPTS - 1])
def test_a_command_that_is_late_is_waited_for_again(admin: tuple[Admin, LockStep], waits: int) -> None:
    servicer, pace = admin
    servicer.deaf_to = waits
    pace.opened(7)
    pace.pause(0.003)
    assert servicer.waited_for == [7] * (waits + 1)
    assert pace.host_now_ns() == 3_000_000


def test_a_command_that_never_comes_is_not_waited_for_any_more(admin: tuple[Admin, LockStep]) -> None:
    servicer, pace = admin
    servicer.deaf_to = 1000
    pace.opened(7)
    pace.pause(0.003)
    pace.pause(0.003)
    assert servicer.waited_for == [7] * COMMAND_ATTEMPTS + [0, 0]


def test_a_command_goes_with_the_next_step_and_with_no_other(admin: tuple[Admin, LockStep]) -> None:
    servicer, pace = admin
    commands: list[bytes] = []

    def step(request: Any, response: Any) -> None:
        commands.append(request.command)
        response.elapsed_ns, response.refusal = 1, "no" if request.command == b"no" else ""

    servicer.step_socket._step = step
    stream = Departures()
    send = pace.sender(stream)  # type: ignore[arg-type]
    send(8, b"eight")
    pace.go_on(0, 0.1)
    send(9, b"nine")
    pace.pause(0.003)
    pace.pause(0.003)
    send(10, b"ten")
    pace.released()
    pace.pause(0.003)
    assert commands == [b"eight", b"nine", b"", b""]
    assert stream.keys == [8, 9, 10]
    send(11, b"no")
    with pytest.raises(LockStepError, match="failed: no"):
        pace.pause(0.003)


class Departures:
    """A stream that notes what leaves."""

    def __init__(self) -> None:
        self.keys: list[int] = []

    def departed(self, key: int) -> None:
        self.keys.append(key)
