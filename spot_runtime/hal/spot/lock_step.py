"""Robot time that passes only when asked: the fake robot's lock-step, behind the same adapter as real time."""

from __future__ import annotations

import socket
from collections.abc import Callable
from typing import Any, Final

import grpc

from spot_model.robot.facts import NS_PER_S, STATE_PERIOD_NS
from spot_model.robot.state import RobotState
from spot_protos import fake_admin_pb2
from spot_protos.stub import stub
from spot_runtime.hal.errors import LockStepError
from spot_runtime.hal.spot.command_stream import CommandStream
from spot_runtime.hal.spot.pace import Jobs, States
from spot_runtime.hal.spot.state_receiver import OnEnd, OnWire, PolledStates, StateQueue, take_all
from spot_runtime.hal.spot.vendor_errors import describe_error
from spot_runtime.host.clock import ClockSample, RobotClockEstimate

ANSWER_TIMEOUT_S: Final = 10.0
"""Host time within which a step must be done."""


class StepSocket:
    """One step at a time, a datagram each way. Methods raise ``OSError`` where the fake robot is gone or hangs."""

    def __init__(self, path: str) -> None:
        """Connect to the socket that the admin service tells."""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.settimeout(ANSWER_TIMEOUT_S)
        try:
            self._socket.connect(path)
        except BaseException:
            self._socket.close()
            raise

    def ask(self, request: fake_admin_pb2.StepRequest) -> None:
        """Begin a step."""
        self._socket.send(request.SerializeToString())

    def answer(self) -> fake_admin_pb2.StepResponse:
        """Wait for the end of the step that was asked for."""
        datagram = self._socket.recv(1 << 18)
        if not datagram:
            raise ConnectionResetError("it ended")
        return fake_admin_pb2.StepResponse.FromString(datagram)

    def close(self) -> None:
        """End it."""
        self._socket.close()


STEP_MAX_NS: Final = 30_000_000
COMMAND_TIMEOUT_S: Final = 2.0
"""Host time for which the fake robot waits for a command that was handed over, before it says that none came."""

COMMAND_ATTEMPTS: Final = 5
"""Such waits in a row after which a command counts as lost. A computer that stood still lets one pass. A stream that
has ended says so meanwhile, and then no command is waited for."""


class LockStep:
    """Advances the fake robot through its admin service; keeps :class:`spot_runtime.hal.spot.pace.Pace`.

    Steps wait for the first command, which comes on the stream; a later one goes with the request for the next step. So
    a run does not depend on the host's speed. The host's clock runs on with robot time. The robot's clock is estimated
    as in real time, from stamps that each step brings, so that a robot whose clock is set does here what it does there.
    """

    def __init__(self, admin_address: str, host_now_ns: int, *, every_state: bool = False) -> None:
        """Connect to the admin service at ``HOST:PORT`` or ``unix:/path``; host stamps run on from ``host_now_ns``.

        With ``every_state`` the loop wakes at each state, as in real time, and not only where a tick is due.

        Raises:
            LockStepError: Nothing answers there, or the fake robot is not in lock-step mode.
        """
        self._address = admin_address
        status = self._status()
        if not status.lock_step:
            raise LockStepError(f"the fake robot at {admin_address} runs in real time; start it with --lock-step")
        try:
            self._steps = StepSocket(status.step_socket)
        except OSError as error:
            told = f"its socket for steps ({status.step_socket or 'none'}): {error}; start this program where it runs"
            raise LockStepError(f"the fake robot at {admin_address} cannot be stepped by {told}") from error
        self._asked: fake_admin_pb2.StepRequest | None = None
        self._elapsed_ns, self._robot_ns = int(status.elapsed_ns), int(status.robot_stamp_ns)
        self._earlier_commands = int(status.commands_submitted)
        self._host_minus_elapsed_ns = host_now_ns - self._elapsed_ns
        self._estimate = RobotClockEstimate()
        self._sample()
        self._newest_ns = 0
        self._is_silent, self._every_state = False, every_state
        self._states: PolledStates | None = None
        self._jobs: Jobs | None = None
        self._key, self._command = 0, b""

    def sync(self, round_trip: Callable[[], int]) -> int:
        """From what the last step told; no message is under way for any time here."""
        del round_trip
        return self._sample()

    def start(self, jobs: Jobs) -> None:
        """Run the chores as robot time passes."""
        self._jobs = jobs

    def chore_now_s(self) -> float:
        """Robot time that has passed."""
        return self._elapsed_ns / NS_PER_S

    def host_now_ns(self) -> int:
        """Robot time that has passed, and a constant."""
        return self._elapsed_ns + self._host_minus_elapsed_ns

    def robot_now_ns(self) -> int:
        """The robot's clock, as estimated: exactly, unless it was set."""
        return self._estimate.robot_ns(self.host_now_ns())

    def open_states(self, open_stream: Callable[[], States], on_wire: OnWire, on_end: OnEnd) -> States:
        """Take the states with the answers to each step: one message in place of seven, at the same robot time.

        A state counts as received when it was sampled: while a step is under way, no clock runs here.
        """
        del open_stream
        self._states = PolledStates(self._receipt_ns, on_wire, on_end)
        return self._states

    def begin(self, activate: Callable[[], None]) -> None:
        """Let the first command arrive, then activate; in this thread, so that every run goes alike."""
        self._advance(0)
        activate()

    def pause(self, duration_s: float) -> None:
        """Let robot time pass."""
        left_ns = round(duration_s * NS_PER_S)
        while left_ns > 0:
            step_ns = min(left_ns, STEP_MAX_NS)
            self._advance(step_ns)
            left_ns -= step_ns

    def go_on(self, until_robot_ns: int, timeout_s: float) -> None:
        """Begin to advance towards the instant at which a state stamped ``until_robot_ns`` arrives."""
        self.finish_step()
        wanted = -(-(until_robot_ns - self._newest_ns) // STATE_PERIOD_NS) if self._newest_ns else 1
        # While states are missing, small steps: the loop looks around as often as it does in real time.
        wanted = 1 if self._is_silent or self._every_state else max(1, min(wanted, STEP_MAX_NS // STATE_PERIOD_NS))
        # A state that comes this much later than its place in the stream is not waited for: time must pass for the
        # watchdogs as it does in real time.
        longest_ns = wanted * STATE_PERIOD_NS + round(timeout_s * NS_PER_S)
        self._ask(fake_admin_pb2.StepRequest(state_messages=wanted, max_duration_ns=longest_ns))

    def receive(self, states: StateQueue, until_robot_ns: int, timeout_s: float) -> list[RobotState]:
        """Advance as :meth:`go_on` does, unless it has begun to; take what has come."""
        if self._asked is None:
            self.go_on(until_robot_ns, timeout_s)
        self.finish_step()
        received = take_all(states)
        self._is_silent = not received
        if received:
            self._newest_ns = max(self._newest_ns, received[-1].robot_stamp_ns)
        return received

    def opened(self, key: int) -> None:
        """The next steps wait for the first command."""
        self._key = key

    def sender(self, stream: CommandStream) -> Callable[[int, bytes], None]:
        """A command goes with the next step: one message in place of two."""

        def send(key: int, wire: bytes) -> None:
            self._command = wire
            stream.departed(key)

        return send

    def released(self) -> None:
        """No command is on its way any more."""
        self._key, self._command = 0, b""

    def stop(self) -> None:
        """Close the socket."""
        self._jobs = self._asked = None
        self._steps.close()

    def _sample(self) -> int:
        host_ns = self.host_now_ns()
        return self._estimate.add(ClockSample(host_ns, self._robot_ns, self._robot_ns, host_ns))

    def _receipt_ns(self, stamp_ns: int) -> int:
        host_ns = self.host_now_ns()
        return min(host_ns, stamp_ns - self._estimate.skew_ns(host_ns))

    def _advance(self, duration_ns: int) -> None:
        self.finish_step()
        self._ask(fake_admin_pb2.StepRequest(duration_ns=duration_ns))
        self.finish_step()

    def _ask(self, request: fake_admin_pb2.StepRequest) -> None:
        request.with_states = self._states is not None
        request.wait_for_command_key, request.wait_timeout_s = self._key, COMMAND_TIMEOUT_S
        request.wait_beyond_commands = self._earlier_commands
        request.command, self._command = self._command, b""
        self._begin(request)

    def _begin(self, request: fake_admin_pb2.StepRequest) -> None:
        try:
            self._steps.ask(request)
        except OSError as error:
            raise self._lost(str(error)) from error
        self._asked = request

    def finish_step(self) -> None:
        """Wait for the end of a step that is under way, take its states, then run the chores that are due."""
        if self._asked is None:
            return
        try:
            response = self._answer(self._asked)
        finally:
            self._asked = None
        self._elapsed_ns, self._robot_ns = int(response.elapsed_ns), int(response.robot_stamp_ns)
        if self._states is not None:
            self._states.feed(response.states, response.states_ended)
        if self._jobs is not None:
            self._jobs.run_due(self.chore_now_s())

    def _answer(self, request: fake_admin_pb2.StepRequest) -> fake_admin_pb2.StepResponse:
        for attempt in range(COMMAND_ATTEMPTS + 1):
            try:
                response = self._steps.answer()
            except OSError as error:
                raise self._lost(str(error)) from error
            if not response.refusal:
                return response
            if not request.wait_for_command_key:
                break
            if attempt + 1 == COMMAND_ATTEMPTS:
                self._key = 0  # the stream has ended; the adapter says why
            request.wait_for_command_key = self._key
            self._begin(request)
        raise self._lost(response.refusal)

    def _status(self) -> Any:
        with grpc.insecure_channel(self._address) as channel:
            admin = stub(channel, fake_admin_pb2)
            try:
                return admin.GetStatus(fake_admin_pb2.GetStatusRequest(), timeout=ANSWER_TIMEOUT_S)
            except grpc.RpcError as error:
                doing = "asking for its status through the fake robot's admin service"
                raise LockStepError(f"{doing} at {self._address} failed: {describe_error(error)}") from error

    def _lost(self, reason: str) -> LockStepError:
        return LockStepError(f"stepping the fake robot at {self._address} failed: {reason}")
