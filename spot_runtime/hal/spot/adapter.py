"""The adapter for everything that speaks Boston Dynamics' API: a Spot, or the fake one."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

from bosdyn.api import robot_state_pb2
from bosdyn.client.robot_command import RobotCommandStreamingClient
from bosdyn.client.robot_state import RobotStateStreamingClient

from spot_log.format.events import EventName
from spot_log.format.records import EventRecord
from spot_log.write.sink import LogSink
from spot_model.robot.facts import NS_PER_S
from spot_model.robot.state import Gains, JointCommand, RobotState, SlowState
from spot_runtime.config import RunConfig
from spot_runtime.hal.address import Address, parse_address
from spot_runtime.hal.base import Hal, JointControl, RobotInfo
from spot_runtime.hal.credentials import find_credentials
from spot_runtime.hal.errors import EstopError, HalError, LeaseHeldError
from spot_runtime.hal.registry import Adapter, HalRequest
from spot_runtime.hal.spot.arm import Arm
from spot_runtime.hal.spot.command_stream import CommandEncoder, CommandStream
from spot_runtime.hal.spot.keepalive import watch_for_silence
from spot_runtime.hal.spot.lock_step import LockStep
from spot_runtime.hal.spot.motions import Motions
from spot_runtime.hal.spot.pace import Jobs, Pace, RealTime, States
from spot_runtime.hal.spot.power_off import power_off
from spot_runtime.hal.spot.session import RobotCalls
from spot_runtime.hal.spot.state_receiver import OnEnd, StateReceiver, take_all
from spot_runtime.host.clock import HostClock, RobotClockEstimate
from spot_runtime.stops import Stop, StopReason, unforeseen


def adapter(request: HalRequest) -> Adapter:
    """The adapter of a Spot or the fake one at ``HOST``, ``HOST:PORT`` or ``unix:/path``; for ``--hal spot``."""
    address = parse_address(request.robot)

    def make(sink: LogSink) -> Hal:
        pace = LockStep(request.lock_step, HostClock().now_ns()) if request.lock_step else None
        return BosdynHal(address, request.config, sink, pace)

    return Adapter(str(address), make, lambda: find_credentials(request.config.robot.credentials_file, os.environ))


CHECK_INS_LOST: Final = 2
"""So many failures in a row are a stop. Three check-ins fall into the endpoint's time-out, so the robot has not cut the
power yet."""


class BosdynHal:
    """Keeps the protocol of :class:`spot_runtime.hal.base.Hal` over the vendor's SDK."""

    def __init__(
        self,
        address: Address,
        config: RunConfig,
        sink: LogSink,
        pace: Pace | None = None,
        *,
        tell: Callable[[EventRecord], None] = lambda _: None,
    ) -> None:
        """Prepare; nothing is sent yet. The sink takes every state as its wire bytes, and every slow state.

        Robot time passes by itself unless ``pace`` says otherwise; ``tell`` is also told of every event, and must not
        block.
        """
        self._tell = tell
        self._events: deque[EventRecord] = deque()
        self._config, self._sink = config, sink
        clock = HostClock()
        self._estimate = RobotClockEstimate()
        self._pace: Pace = pace or RealTime(clock, self._estimate)
        self._session = RobotCalls(address, config.robot, clock, self._estimate, self._pace.host_now_ns)
        self._jobs = Jobs(self._job_failed)
        self._problems: deque[Stop] = deque(maxlen=100)
        self._slow: SlowState | None = None
        self._synced_ns = 0
        self._failed_check_ins = 0
        self._has_powered_on, self._is_power_in_doubt, self._is_powering_off = False, False, False
        self._states: States | None = None
        self._commands: CommandStream | None = None
        self._send: Callable[[int, bytes], None] = lambda _key, _wire: None
        self._command_channel: Any = None
        self._arm = Arm(self._problems)
        self._encoder = CommandEncoder(config.robot.client_name, config.control.velocity_safety_limit_rad_s, self._arm)
        self._joint_control = JointControl.OFF
        self._gains: Gains | None = None
        self._is_closed = False

    # The protocol ----------------------------------------------------------------------------------------------------

    def connect(self) -> RobotInfo:
        """See the protocol."""
        session, robot = self._session, self._config.robot
        robot_id = session.log_in()
        session.sync_clocks()
        self._synced_ns = self.host_now_ns()
        self._slow = session.check_faults(self._config.safety, self._pause)
        # The lease first: only the robot's holder may replace an e-stop.
        session.acquire_lease()
        self._pace.start(self._jobs)
        self._keep_lease()
        if why := watch_for_silence(session.calls, session.lease, robot, self._jobs, self._pace.chore_now_s()):
            self._occurred(EventName.NO_KEEPALIVE, why)
        if session.set_up_estop():
            self._jobs.add("estop", robot.estop_timeout_s / 3.0, self._check_in, now_s=self._pace.chore_now_s())
        session.check_estop(self._pause)
        now_s = self._pace.chore_now_s()
        self._jobs.add("time_sync", robot.time_sync_period_s, self._sync_clocks, now_s=now_s)
        self._jobs.add("slow_state", 1.0 / robot.slow_state_rate_hz, self._poll, now_s=now_s)
        # Opened now: a handshake takes too long once commands must flow.
        self._command_channel = session.streaming_channel(RobotCommandStreamingClient)
        self._open_states()
        return RobotInfo("bosdyn", robot_id, self._skew_s(), 2.0 * self._estimate.uncertainty_ns() / NS_PER_S)

    def stand(self) -> None:
        """See the protocol."""
        if not self._has_powered_on:
            self._is_power_in_doubt = True
            self._motions().power_on()
            self._has_powered_on, self._is_power_in_doubt = True, False
        self._motions().stand()
        # States have piled up meanwhile; the loop starts with the present.
        if self._states is not None:
            self._arm.watch(take_all(self._states.states))
        self._arm.refuse_out()

    def receive(self, until_robot_ns: int, timeout_s: float) -> list[RobotState]:
        """See the protocol."""
        if self._states is None:
            raise HalError("there is no state stream; connect first")
        self._tell_events()
        states = self._pace.receive(self._states.states, until_robot_ns, timeout_s)
        return states if self._arm.n_joints == 0 else self._arm.watch(states)

    def go_on(self, until_robot_ns: int, timeout_s: float) -> None:
        """See the protocol."""
        self._pace.go_on(until_robot_ns, timeout_s)

    def robot_now_ns(self) -> int:
        """See the protocol."""
        return self._pace.robot_now_ns()

    def host_now_ns(self) -> int:
        """See the protocol."""
        return self._pace.host_now_ns()

    def begin_joint_control(self, first: JointCommand) -> None:
        """See the protocol. The stream is opened first, then joint control is asked for, as in the vendor's example."""
        if not self._arm.take_hold():
            self._joint_control = JointControl.FAILED
            return
        self._joint_control = JointControl.PENDING
        wire = (first.key, self._encoder.encode(first, self._pace.host_now_ns()))
        self._commands = CommandStream(
            self._command_channel, wire, now_ns=self._pace.host_now_ns, on_end=self._commands_ended
        )
        self._send = self._pace.sender(self._commands)
        self._pace.opened(first.key)
        self._pace.begin(partial(self._activate, self._motions()))

    def end_joint_control(self) -> None:
        """See the protocol."""
        motions = self._motions()
        self._joint_control = JointControl.LEAVING
        self._pace.begin(partial(self._leave, motions))

    @property
    def joint_control(self) -> JointControl:
        """See the protocol."""
        return self._joint_control

    def send(self, command: JointCommand) -> None:
        """See the protocol."""
        commands = self._commands  # another thread may end the stream meanwhile
        if commands is not None and self._joint_control is not JointControl.FAILED:
            if command.gains is not self._gains:
                self._gains = command.gains
                if not command.gains.kp_nm_per_rad.any():
                    self._session.end_motions()  # joints that are damped are given up
            self._send(command.key, self._encoder.encode(command, self._pace.host_now_ns()))

    def departures(self) -> Sequence[tuple[int, int]]:
        """See the protocol."""
        commands = self._commands
        return () if commands is None else commands.departures()

    def release(self) -> None:
        """See the protocol."""
        self._session.end_motions()
        self._pace.finish_step()
        self._stop_commands()

    def estop(self) -> None:
        """See the protocol."""
        self._session.end_motions()
        self._jobs.remove("estop")
        self._pace.begin(self._cut_power)

    @property
    def slow_state(self) -> SlowState | None:
        """See the protocol."""
        return self._slow

    @property
    def clock_age_s(self) -> float:
        """See the protocol."""
        return (self.host_now_ns() - self._synced_ns) / NS_PER_S

    def problems(self) -> Sequence[Stop]:
        """See the protocol."""
        return [self._problems.popleft() for _ in range(len(self._problems))]

    def power_off(self) -> None:
        """See the protocol."""
        self._is_powering_off = True
        try:
            if self._session.lease is not None:
                power_off(
                    self._session,
                    self._motions,
                    self._pause,
                    self._pace,
                    timeout_s=self._config.robot.power_timeout_s,
                    even_if_off=self._is_power_in_doubt,
                    on_taken_up=self._lease_taken_up,
                )
        finally:
            self.release()

    def close(self) -> None:
        """See the protocol."""
        if self._is_closed:
            return
        self._is_closed = True
        self.release()
        self._pace.stop()
        if self._states is not None:
            self._states.stop()
        self._session.close()

    # Details ---------------------------------------------------------------------------------------------------------

    def _motions(self) -> Motions:
        return self._session.motions(self._pause)

    def _keep_lease(self) -> None:
        period_s, now_s = self._config.robot.lease_period_s, self._pace.chore_now_s()
        self._jobs.add("lease", period_s, self._session.retain_lease, now_s=now_s)

    def _lease_taken_up(self) -> None:
        self._problems = deque((p for p in self._problems if p.reason is not StopReason.LEASE_LOST), maxlen=100)
        self._keep_lease()
        self._occurred(EventName.LEASE_TAKEN_UP, "nobody had it any more; the robot sits down under it and powers off")

    def _occurred(self, name: EventName, text: str) -> None:
        """In any thread; the one that writes the run's other events tells of it."""
        self._events.append(EventRecord(self.host_now_ns(), self.robot_now_ns(), name.severity, name.label, text))

    def _tell_events(self) -> None:
        while self._events:
            record = self._events.popleft()
            self._sink.put(record)
            self._tell(record)

    def _pause(self, duration_s: float) -> None:
        self._tell_events()
        self._pace.pause(duration_s)
        for problem in tuple(self._problems):  # another thread may add to them
            if problem.reason is StopReason.LEASE_LOST:
                raise LeaseHeldError(problem.sentence())
            if problem.reason is StopReason.ESTOPPED and not self._is_powering_off:
                raise EstopError(problem.sentence())

    def _open_states(self) -> None:
        def lost(reason: str) -> None:
            self._problems.append(Stop(StopReason.STATE_LOST, reason))

        def open_stream() -> StateReceiver:
            return self._state_stream(lost)

        self._states = self._pace.open_states(open_stream, self._sink.put, lost)

    def _state_stream(self, on_end: OnEnd) -> StateReceiver:
        request = robot_state_pb2.RobotStateStreamRequest()
        request.header.client_name = self._config.robot.client_name
        stamp = request.header.request_timestamp
        stamp.seconds, stamp.nanos = divmod(self._pace.host_now_ns(), NS_PER_S)

        def reopened(lived_s: float) -> None:
            self._occurred(EventName.STATES_REOPENED, f"it had been open for {lived_s:.1f} s")

        return StateReceiver(
            self._session.streaming_channel(RobotStateStreamingClient),
            request,
            now_ns=self._pace.host_now_ns,
            on_wire=self._sink.put,
            on_end=on_end,
            on_reopen=reopened,
        )

    # Each of these three has a thread of its own, whose end with an error nobody would see.

    def _activate(self, motions: Motions) -> None:
        try:
            motions.ask_for_joint_control()
        except Exception as error:  # noqa: BLE001
            stop = Stop(StopReason.ACTIVATION_FAILED, str(error))
            motions.if_wanted(lambda: self._fail(JointControl.FAILED, stop))
        else:
            motions.if_wanted(self._activated)

    def _cut_power(self) -> None:
        try:
            self._session.cut_power()
        except Exception as error:  # noqa: BLE001
            self._problems.append(Stop(StopReason.LINK_LOST, f"the e-stop could not be pressed: {error}"))

    def _leave(self, motions: Motions) -> None:
        try:
            motions.ask_for_stand()
        except Exception as error:  # noqa: BLE001
            stop = Stop(StopReason.HAND_BACK_FAILED, str(error))
            # The joints are still ours, and so are the commands that damp them.
            motions.if_wanted(lambda: self._fail(JointControl.ACTIVE, stop))
        else:
            motions.if_wanted(self._stop_commands)

    def _activated(self) -> None:
        if self._joint_control is JointControl.PENDING:
            self._joint_control = JointControl.ACTIVE

    def _fail(self, joint_control: JointControl, stop: Stop) -> None:
        self._joint_control = joint_control
        self._problems.append(stop)

    def _stop_commands(self) -> None:
        self._joint_control = JointControl.OFF
        commands, self._commands = self._commands, None
        if commands is not None:
            commands.stop()
            self._pace.released()
        self._arm.let_go()  # last: what still goes out has all joints

    def _commands_ended(self, verdict: str) -> None:
        # The robot ends the stream by itself when the vendor's stand takes over.
        if self._joint_control in (JointControl.OFF, JointControl.LEAVING):
            return
        self._joint_control = JointControl.FAILED
        self._pace.released()
        self._problems.append(self._session.why_refused(verdict, self._skew_s()))

    def _skew_s(self) -> float:
        """Robot clock minus host clock; known once connected."""
        return (self.robot_now_ns() - self.host_now_ns()) / NS_PER_S

    def _sync_clocks(self) -> None:
        off_s = self._pace.sync(self._session.sync_once) / NS_PER_S
        self._synced_ns = self.host_now_ns()
        bound_s = self._config.safety.clock_jump_s
        if abs(off_s) > bound_s:
            self._problems.append(Stop(StopReason.CLOCK_JUMPED, "", {"off_s": off_s, "bound_s": bound_s}))

    def _poll(self) -> None:
        self._slow = slow = self._session.poll()
        self._sink.put(slow)

    def _check_in_failed(self, error: Exception) -> None:
        """One failed check-in is not a pressed e-stop: after a lost answer the robot also refuses the next one."""
        self._failed_check_ins += 1
        if self._failed_check_ins < CHECK_INS_LOST:
            return
        reason = StopReason.ESTOPPED if isinstance(error, EstopError) else StopReason.LINK_LOST
        self._problems.append(Stop(reason, f"{self._failed_check_ins} e-stop check-ins in a row failed: {error}"))

    def _check_in(self) -> None:
        self._session.check_in_estop()
        self._failed_check_ins = 0

    def _job_failed(self, name: str, error: Exception) -> None:
        if name == "lease" and isinstance(error, LeaseHeldError):
            self._jobs.remove("lease")
            self._session.has_lease = False
            self._problems.append(Stop(StopReason.LEASE_LOST, str(error)))
        elif name == "estop":
            self._check_in_failed(error)
        elif not isinstance(error, HalError):
            self._problems.append(unforeseen(error, name))
