"""Robot time that passes only when asked: the fake robot's lock-step, behind the same adapter as real time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import grpc

from spot_model.robot.facts import STATE_PERIOD_NS
from spot_model.robot.stamps import NS_PER_S
from spot_model.robot.state import RobotState
from spot_protos import fake_admin_pb2
from spot_runtime.hal.errors import LockStepError
from spot_runtime.hal.spot.jobs import Jobs
from spot_runtime.hal.spot.pace import States
from spot_runtime.hal.spot.state_receiver import OnEnd, OnWire, PolledStates, StateQueue, take_all
from spot_runtime.hal.spot.vendor_errors import describe
from spot_runtime.host.clock import ClockSample, RobotClockEstimate

STEP_METHOD: Final = "/spot_rl.fake.v1.FakeAdmin/Step"
STATUS_METHOD: Final = "/spot_rl.fake.v1.FakeAdmin/GetStatus"
STEP_MAX_NS: Final = 30_000_000
COMMAND_TIMEOUT_S: Final = 2.0
"""Host time for which the fake robot waits for a command that was handed over, before it says that none came."""

COMMAND_ATTEMPTS: Final = 5
"""Such waits in a row after which a command counts as lost. A computer that stood still lets one pass. A stream that
has ended says so meanwhile, and then no command is waited for."""

ANSWER_TIMEOUT_S: Final = 10.0
"""Host time within which a step must be done and its states must have arrived."""


class LockStep:
    """Advances the fake robot through its admin service; keeps :class:`spot_runtime.hal.spot.pace.Pace`.

    Every step first waits until the newest command has arrived, so that a run does not depend on the host's speed.
    The host's clock runs on with robot time. The robot's clock is estimated as in real time, from stamps that each step
    brings, so that a robot whose clock is set does here what it does there.
    """

    def __init__(self, admin_address: str, host_now_ns: int, *, every_state: bool = False) -> None:
        """Connect to the admin service.

        Args:
            admin_address: ``HOST:PORT`` or ``unix:/path``.
            host_now_ns: What the host's clock says now; host stamps run on from here.
            every_state: Whether the loop wakes at each state, as in real time, and not only where a tick is due.

        Raises:
            LockStepError: Nothing answers there, or the fake robot is not in lock-step mode.
        """
        self._address = admin_address
        self._channel = grpc.insecure_channel(admin_address)
        self._step: Any = self._channel.unary_unary(
            STEP_METHOD,
            request_serializer=fake_admin_pb2.StepRequest.SerializeToString,
            response_deserializer=fake_admin_pb2.StepResponse.FromString,
        )
        status = self._status()
        if not status.lock_step:
            raise LockStepError(f"the fake robot at {admin_address} runs in real time; start it with --lock-step")
        self._elapsed_ns, self._robot_ns = int(status.elapsed_ns), int(status.robot_stamp_ns)
        self._earlier_commands = int(status.commands_submitted)
        self._host_minus_elapsed_ns = host_now_ns - self._elapsed_ns
        self._estimate = RobotClockEstimate()
        self._sample()
        self._newest_ns = 0
        self._is_silent, self._every_state = False, every_state
        self._states: PolledStates | None = None
        self._jobs: Jobs | None = None
        self._key = 0

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

    def receive(self, states: StateQueue, until_robot_ns: int, timeout_s: float) -> list[RobotState]:
        """Advance towards the instant at which a state stamped ``until_robot_ns`` arrives; take what has come."""
        wanted = -(-(until_robot_ns - self._newest_ns) // STATE_PERIOD_NS) if self._newest_ns else 1
        # While states are missing, small steps: the loop looks around as often as it does in real time.
        wanted = 1 if self._is_silent or self._every_state else max(1, min(wanted, STEP_MAX_NS // STATE_PERIOD_NS))
        # A state that comes this much later than its place in the stream is not waited for: time must pass for the
        # watchdogs as it does in real time.
        longest_ns = wanted * STATE_PERIOD_NS + round(timeout_s * NS_PER_S)
        self._step_on(fake_admin_pb2.StepRequest(state_messages=wanted, max_duration_ns=longest_ns))
        received = take_all(states)
        self._is_silent = not received
        if received:
            self._newest_ns = max(self._newest_ns, received[-1].robot_stamp_ns)
        return received

    def sent(self, key: int) -> None:
        """The next step waits for this command."""
        self._key = key

    def released(self) -> None:
        """No command is on its way any more."""
        self._key = 0

    def stop(self) -> None:
        """Close the channel."""
        self._jobs = None
        self._channel.close()

    def _sample(self) -> int:
        host_ns = self.host_now_ns()
        return self._estimate.add(ClockSample(host_ns, self._robot_ns, self._robot_ns, host_ns))

    def _receipt_ns(self, stamp_ns: int) -> int:
        host_ns = self.host_now_ns()
        return min(host_ns, stamp_ns - self._estimate.skew_ns(host_ns))

    def _advance(self, duration_ns: int) -> None:
        self._step_on(fake_admin_pb2.StepRequest(duration_ns=duration_ns))

    def _step_on(self, request: fake_admin_pb2.StepRequest) -> None:
        """Step, take the states, then run the chores that are due."""
        response = self._answer(request)
        self._elapsed_ns, self._robot_ns = int(response.elapsed_ns), int(response.robot_stamp_ns)
        if self._states is not None:
            self._states.feed(response.states, response.states_ended)
        if self._jobs is not None:
            self._jobs.run_due(self.chore_now_s())

    def _answer(self, request: fake_admin_pb2.StepRequest) -> Any:
        request.with_states = self._states is not None
        request.wait_timeout_s, request.wait_beyond_commands = COMMAND_TIMEOUT_S, self._earlier_commands
        for _ in range(COMMAND_ATTEMPTS):
            request.wait_for_command_key = self._key
            try:
                return self._step(request, timeout=ANSWER_TIMEOUT_S)
            except grpc.RpcError as error:
                if error.code() is not grpc.StatusCode.DEADLINE_EXCEEDED or not request.wait_for_command_key:
                    raise self._error("stepping", error) from error
        self._key = 0  # the stream has ended; the adapter says why
        return self._answer(request)

    def _status(self) -> Any:
        call = self._channel.unary_unary(
            STATUS_METHOD,
            request_serializer=fake_admin_pb2.GetStatusRequest.SerializeToString,
            response_deserializer=fake_admin_pb2.GetStatusResponse.FromString,
        )
        try:
            return call(fake_admin_pb2.GetStatusRequest(), timeout=ANSWER_TIMEOUT_S)
        except grpc.RpcError as error:
            self._channel.close()
            raise self._error("asking for its status", error) from error

    def _error(self, doing: str, error: grpc.RpcError) -> LockStepError:
        return LockStepError(
            f"{doing} through the fake robot's admin service at {self._address} failed: {describe(error)}"
        )
