"""Robot time that passes only when asked: the fake robot's lock-step, behind the same adapter as real time."""

from __future__ import annotations

import queue
import time
from collections import deque
from typing import Any, Final

import grpc

from spot_model.facts import STATE_PERIOD_NS
from spot_model.state import RobotState
from spot_protos import fake_admin_pb2
from spot_runtime.clock import NS_PER_S
from spot_runtime.hal.errors import LockStepError
from spot_runtime.hal.jobs import Jobs
from spot_runtime.hal.pace import StateQueue
from spot_runtime.hal.vendor_errors import describe

STEP_METHOD: Final = "/spot_rl.fake.v1.FakeAdmin/Step"
STATUS_METHOD: Final = "/spot_rl.fake.v1.FakeAdmin/GetStatus"
STEP_MAX_NS: Final = 30_000_000
LAG_MAX_NS: Final = 8_000_000
"""Longest delay of a state that a step allows for; a longer one costs more steps."""

COMMAND_TIMEOUT_S: Final = 2.0
"""Host time within which a command that was handed over must have arrived."""

ANSWER_TIMEOUT_S: Final = 10.0
"""Host time within which a step must be done and its states must have arrived."""


class LockStep:
    """Advances the fake robot through its admin service; keeps :class:`spot_runtime.hal.pace.Pace`.

    Every step first waits until the newest command has arrived, so that a run does not depend on the host's speed.
    Host stamps are the robot's, less a constant.
    """

    def __init__(self, admin_address: str, host_now_ns: int) -> None:
        """Connect to the admin service.

        Args:
            admin_address: ``HOST:PORT`` or ``unix:/path``.
            host_now_ns: What the host's clock says now; host stamps run on from here.

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
        self._robot_ns = int(status.robot_stamp_ns)
        self._host_minus_robot_ns = host_now_ns - self._robot_ns
        self._newest_ns = 0
        self._lags_ns: deque[int] = deque([0], maxlen=4)
        self._jobs: Jobs | None = None
        self._key = 0

    @property
    def knows_robot_time(self) -> bool:
        """The admin service tells it."""
        return True

    def start(self, jobs: Jobs) -> None:
        """Run the chores as robot time passes."""
        self._jobs = jobs

    def chore_now_s(self) -> float:
        """The robot's clock."""
        return self._robot_ns / NS_PER_S

    def host_now_ns(self) -> int:
        """The robot's clock, less a constant."""
        return self._robot_ns + self._host_minus_robot_ns

    def robot_now_ns(self) -> int:
        """The robot's clock, exactly."""
        return self._robot_ns

    def receipt_ns(self, robot_stamp_ns: int) -> int:
        """States count as received when they were sampled: while a step is under way, no clock runs here."""
        return robot_stamp_ns + self._host_minus_robot_ns

    def begin(self, activate: Any) -> None:
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
        lag_ns = self._robot_ns - self._newest_ns if self._newest_ns else 0
        self._lags_ns.append(min(lag_ns, LAG_MAX_NS))
        wanted_ns = until_robot_ns + max(self._lags_ns) - self._robot_ns
        is_stale = lag_ns > 2 * STEP_MAX_NS
        longest_ns = min(STEP_MAX_NS, round(timeout_s * NS_PER_S)) if is_stale else STEP_MAX_NS
        sent_ns = self._advance(min(longest_ns, max(STATE_PERIOD_NS, wanted_ns)))
        received: list[RobotState] = []
        while self._newest_ns < sent_ns:
            try:
                state = states.get(timeout=ANSWER_TIMEOUT_S)
            except queue.Empty:
                raise LockStepError(
                    f"a state stamped {sent_ns} was sent but did not arrive; is the stream open?"
                ) from None
            if state is None:
                break
            received.append(state)
            self._newest_ns = max(self._newest_ns, state.robot_stamp_ns)
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

    def _advance(self, duration_ns: int) -> int:
        """Step, then run the chores that are due. Returns the stamp of the newest state that was sent."""
        request = fake_admin_pb2.StepRequest(
            duration_ns=duration_ns, wait_for_command_key=self._key, wait_timeout_s=COMMAND_TIMEOUT_S
        )
        try:
            response = self._step(request, timeout=ANSWER_TIMEOUT_S)
        except grpc.RpcError as error:
            if error.code() is not grpc.StatusCode.DEADLINE_EXCEEDED or not self._key:
                raise self._error("stepping", error) from error
            self._key = 0  # the stream has ended; the adapter says why
            return self._advance(duration_ns)
        self._robot_ns = int(response.robot_stamp_ns)
        if self._jobs is not None:
            self._jobs.run_due(self.chore_now_s())
        return int(response.last_state_robot_stamp_ns)

    def _status(self) -> Any:
        call = self._channel.unary_unary(
            STATUS_METHOD,
            request_serializer=fake_admin_pb2.GetStatusRequest.SerializeToString,
            response_deserializer=fake_admin_pb2.GetStatusResponse.FromString,
        )
        deadline_s = time.monotonic() + ANSWER_TIMEOUT_S
        try:
            return call(fake_admin_pb2.GetStatusRequest(), timeout=deadline_s - time.monotonic())
        except grpc.RpcError as error:
            self._channel.close()
            raise self._error("asking for its status", error) from error

    def _error(self, doing: str, error: grpc.RpcError) -> LockStepError:
        return LockStepError(
            f"{doing} through the fake robot's admin service at {self._address} failed: {describe(error)}"
        )
