"""Lock-step: robot time passes when a request says so, and states come with the answer."""

from __future__ import annotations

import socket
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import grpc
from bosdyn.api import robot_command_pb2
from google.protobuf.message import DecodeError

from fake_robot.faults.registry import FaultInjector
from fake_robot.services.calls import RefusedCallError
from fake_robot.services.world import World
from spot_model.robot.facts import NS_PER_S
from spot_protos import fake_admin_pb2

MAX_STEP_NS = 3600 * NS_PER_S
MAX_STEP_STATES = 1_000_000
TICK_EVERY_NS = 50_000_000
SEND_BUFFER_BYTES = 1 << 20
"""An answer has to fit: 800 bytes a state."""


class StateTap:
    """Collects what a state stream would bring. Whatever ends state streams ends this one, too."""

    def __init__(self, world: World) -> None:
        """Collect from now on."""
        self._subscription = world.robot.subscribe_state()
        self._forget = world.link.listen("state", self._subscription.close)

    @property
    def is_closed(self) -> bool:
        """Whether no message will come any more."""
        return self._subscription.is_closed

    def take(self) -> list[bytes]:
        """The messages since the last call."""
        return list(iter(lambda: self._subscription.get(0.0), None))

    def close(self) -> None:
        """Collect no more."""
        self._forget()
        self._subscription.close()


class Stepping:
    """Takes one step at a time, from any thread."""

    def __init__(self, world: World, faults: FaultInjector) -> None:
        self._world, self._faults = world, faults
        self._lock = threading.Lock()
        self._tap: StateTap | None = None

    def step(self, request: fake_admin_pb2.StepRequest, response: fake_admin_pb2.StepResponse) -> None:
        """Wait for a command if asked to, then let robot time pass.

        Raises:
            RefusedCallError: The robot runs in real time, the request is not allowed, or the command did not come.
        """
        robot = self._world.robot
        if not robot.is_lock_step:
            raise _not_allowed("the fake runs in real time; start it with --lock-step to use Step")
        durations_ns = (request.duration_ns, request.max_duration_ns)
        if not all(0 <= ns <= MAX_STEP_NS for ns in durations_ns) or request.state_messages > MAX_STEP_STATES:
            raise _not_allowed(
                f"a step is at most {MAX_STEP_NS} ns or {MAX_STEP_STATES} state messages, and not negative"
            )
        with self._lock:
            self._tap_states(request.with_states)
            self._wait_for_command(request)
            if request.command:
                robot.submit_to_open_stream(_joint_command(request.command))
            states_before = robot.states_sent
            if request.WhichOneof("until") == "state_messages":
                self._advance_states(request.state_messages, request.max_duration_ns or None)
            else:
                self._advance(request.duration_ns)
            self._world.stepped_s = time.monotonic()
            response.robot_stamp_ns, response.elapsed_ns = self._world.now_ns(), robot.clock.elapsed_ns()
            response.last_state_robot_stamp_ns = robot.last_state_stamp_ns
            response.states_sent = robot.states_sent - states_before
            if self._tap is not None:
                response.states.extend(self._tap.take())
                if self._tap.is_closed:
                    response.states_ended = self._world.link.why_down() or "the robot ended the state stream"
                    self._tap = None

    def _tap_states(self, is_wanted: bool) -> None:
        if is_wanted and self._tap is None:
            self._tap = StateTap(self._world)
        elif not is_wanted and self._tap is not None:
            self._tap.close()
            self._tap = None

    def _wait_for_command(self, request: fake_admin_pb2.StepRequest) -> None:
        key, wait_s = request.wait_for_command_key, request.wait_timeout_s or 5.0
        beyond = request.wait_beyond_commands
        if key and not self._world.robot.wait_for_command_key(key, wait_s, beyond=beyond):
            raise RefusedCallError(
                grpc.StatusCode.DEADLINE_EXCEEDED,
                f"no command with key {key} or newer arrived within {wait_s:g} s; "
                f"the newest has key {self._world.robot.last_command_key}",
            )

    # Time passes in parts, so that time-outs of leases and e-stops act when they fall due.

    def _advance(self, duration_ns: int) -> None:
        while duration_ns > 0:
            part_ns = min(TICK_EVERY_NS, duration_ns)
            self._world.robot.advance(part_ns)
            duration_ns -= part_ns
            self._tick()

    def _advance_states(self, count: int, max_duration_ns: int | None) -> None:
        robot = self._world.robot
        if max_duration_ns is not None:
            end_ns, goal = robot.clock.elapsed_ns() + max_duration_ns, robot.states_sent + count
            while robot.states_sent < goal and robot.clock.elapsed_ns() < end_ns:
                left_ns = end_ns - robot.clock.elapsed_ns()
                robot.advance_states(goal - robot.states_sent, min(TICK_EVERY_NS, left_ns))
                self._tick()
            return
        while count > 0:
            part = min(16, count)
            robot.advance_states(part)
            count -= part
            self._tick()

    def _tick(self) -> None:
        self._world.tick()
        self._faults.tick()


def _joint_command(wire: bytes) -> robot_command_pb2.JointControlStreamRequest:
    try:
        return robot_command_pb2.JointControlStreamRequest.FromString(wire)
    except DecodeError as error:
        raise _not_allowed(f"command is no JointControlStreamRequest: {error}") from error


def _not_allowed(told: str) -> RefusedCallError:
    return RefusedCallError(grpc.StatusCode.INVALID_ARGUMENT, told)


class StepSocket:
    """Steps without gRPC, for a client that takes fifty a second: a request and its answer are one datagram each.

    Listens on a socket in a private folder until it is closed.
    """

    def __init__(self, step: Callable[[fake_admin_pb2.StepRequest, fake_admin_pb2.StepResponse], None]) -> None:
        """Listen; ``step`` is called from one thread a client."""
        self._step = step
        self._folder = tempfile.TemporaryDirectory(prefix="spot-rl-steps-")
        self.path = str(Path(self._folder.name) / "socket")
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._listener.bind(self.path)
        self._listener.listen()
        threading.Thread(target=self._accept, name="step-socket", daemon=True).start()

    def close(self) -> None:
        """Take no more clients."""
        self._listener.shutdown(socket.SHUT_RDWR)  # which also ends the wait for the next client
        self._listener.close()
        self._folder.cleanup()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=(client,), name="steps", daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        with client:
            client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
            try:
                while datagram := client.recv(65536):
                    client.send(self._answer(datagram).SerializeToString())
            except OSError:
                return  # the client is gone

    def _answer(self, datagram: bytes) -> fake_admin_pb2.StepResponse:
        response = fake_admin_pb2.StepResponse()
        try:
            self._step(fake_admin_pb2.StepRequest.FromString(datagram), response)
        except (RefusedCallError, DecodeError) as error:
            return fake_admin_pb2.StepResponse(refusal=str(error))
        return response
