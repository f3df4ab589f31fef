"""The idle service: it holds no lease and commands nothing; each arming is a process of its own that it looks after.

    idle ──► arming ──► armed ◄──► running ──► ending ──► idle

A control process that dies with the robot in hand leaves a note; then a process of its own makes the robot safe first.
The service manager's watchdog is fed by the control process while that is answerable for the robot (armed, running),
and otherwise by each turn of this object's own loop.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Final

from spot_protos import operator_pb2, run_link_pb2
from spot_runtime.config import RunConfig
from spot_runtime.host.clock import HostClock
from spot_runtime.host.service_manager import ServiceManager
from spot_runtime.operator.refusal import Refusal, not_now, unavailable
from spot_runtime.operator.rescue.rescue_process import Rescue, RescueSpec
from spot_runtime.operator.run.run_spec import RunSpec
from spot_runtime.operator.server.event_history import EventHistory
from spot_runtime.operator.server.operator_events import how_it_died, operator_event
from spot_runtime.operator.server.pending import PendingRequests, SteeringRight
from spot_runtime.operator.server.policy_folder import OfferedPolicy, PolicyFolder
from spot_runtime.operator.server.run_process import RunProcess
from spot_runtime.operator.server.states import State
from spot_runtime.rescue.make_safe import MAY_HAVE_POWER

TURN_S: Final = 0.05
ANSWER_TIMEOUT_S: Final = 25.0
"""Opening a log may take 20 s on a bad disk."""
STOP_TIMEOUT_S: Final = 0.3
"""After this a stop goes by signals, too; the loop answers within a cycle."""

MAX_WAITING: Final = 8
"""Each holds a thread of the service, and one must be left for a stop."""

KILL_AFTER_S: Final = 15.0
SILENT_S: Final = 5.0
"""A control process that is silent for so long hangs; what it last sent has long lapsed, so it is ended."""

ABORT_TAKES_S: Final = 2.0

_STATES: Final = frozenset(state.value for state in State)


class Supervisor:
    """What the service knows and does; its methods may be called from any thread."""

    def __init__(
        self,
        robot: str,
        config: RunConfig,
        *,
        manager: ServiceManager,
        tell: Callable[[operator_pb2.Event], None],
        lock_step: str = "",
    ) -> None:
        """Begin idle.

        Args:
            robot: The robot's address.
            config: Of every run, and of the service.
            manager: The service manager.
            tell: Also told of every event; must not block.
            lock_step: Admin address of a fake robot in lock-step mode.
        """
        self._robot, self._config, self._lock_step = robot, config, lock_step
        self._manager, self._tell = manager, tell
        self.policies = PolicyFolder.of(config.service)
        self.events = EventHistory()
        self._clock = HostClock()
        self._lock = threading.RLock()
        self._changed = threading.Condition(self._lock)
        self._state, self._state_since_s = State.IDLE, time.monotonic()
        self._run: RunProcess | None = None
        self._rescue: Rescue | None = None
        self._run_status: operator_pb2.RunStatus | None = None
        self._run_told_s = 0.0
        self._ended: operator_pb2.Outcome | None = None
        self._last: operator_pb2.Outcome | None = None
        self._waiting, self._steering = PendingRequests(), SteeringRight()
        self._seen_s = 0.0
        self._is_asked_to_end = False

    # Looking ----------------------------------------------------------------------------------------------------------

    @property
    def state(self) -> State:
        """Where the service stands."""
        return self._state

    def status(self) -> operator_pb2.Status:
        """Everything an operator wants to see."""
        now_s = time.monotonic()
        with self._lock:
            status = operator_pb2.Status(
                state=self._state.value,
                robot=self._robot,
                host_stamp_ns=self._clock.now_ns(),
                attendance_left_s=-1.0,
                events=self.events.count,
            )
            if self._run_status is not None:
                status.run.CopyFrom(self._run_status)
                status.run_age_s = now_s - self._run_told_s
            if self._last is not None:
                status.last.CopyFrom(self._last)
            if self._state in (State.ARMED, State.RUNNING):
                status.attendance_left_s = self._config.service.attendance_s - (now_s - self._seen_s)
            status.steered_by = self._steering.holder
            return status

    # Asking -----------------------------------------------------------------------------------------------------------

    def arm(self, policy: OfferedPolicy, labels: dict[str, str], operator: str) -> str:
        """Begin to arm, and wait until the robot stands. Returns what was done. Raises Refusal."""
        with self._lock:
            self._need("arm", State.IDLE)
            spec = RunSpec(
                robot=self._robot,
                config=self._config,
                policy=policy.path.absolute(),
                policy_sha256=policy.sha256,
                labels={**labels, **({"operator": operator} if operator else {})},
                lock_step=self._lock_step,
            )
            try:
                run = self._run = RunProcess.start(spec)
            except OSError as error:
                raise unavailable(f"the control process cannot be started: {error}; see to this computer") from error
            self._ended, self._is_asked_to_end = None, False
            self._set(State.ARMING)
            self._seen()
            self._say("arming", f"policy {policy.name}" + (f", asked by {operator}" if operator else ""))
            while self._run is run and self._state in (State.ARMING, State.ENDING):
                self._changed.wait(1.0)
            if self._run is run:
                return (
                    f"the robot stands under the vendor's control; policy {policy.name} waits for 'spot-rl ctl start'"
                )
            why = self._last.sentence if self._last is not None else "the control process ended"
            raise not_now(f"arming did not succeed: {why}")

    def ask(self, name: str, request: run_link_pb2.ToRun, *states: State, is_stopping: bool = False) -> str:
        """Pass a request on to the control process and wait for its answer. Returns its words. Raises Refusal."""
        with self._lock:
            self._need(name, *states)
            if len(self._waiting) >= MAX_WAITING and not is_stopping:
                raise unavailable(f"{name}: {MAX_WAITING} requests wait for their answers already; wait for one")
            run = self._run
            waiting = self._waiting.add(request)
            self._seen()
        try:
            if run is None or not run.tell(request):
                raise unavailable(f"{name}: the control process takes no requests now; stop it, or see its journal")
            timeout_s = STOP_TIMEOUT_S if is_stopping else ANSWER_TIMEOUT_S
            if not waiting.done.wait(timeout_s) or waiting.answer is None:
                raise unavailable(f"{name}: the control process gave no answer; see status and journal")
        finally:
            with self._lock:
                self._waiting.forget(waiting)
        if not waiting.answer.is_done:
            raise not_now(f"{name}: {waiting.answer.text}")
        return waiting.answer.text

    def end(self, name: str, request: run_link_pb2.ToRun, client: str, *, is_damping: bool) -> str:
        """Stop or damp, also when the control process does not read its socket: then by signals."""
        with self._lock:
            self._need(name, State.ARMING, State.ARMED, State.RUNNING, State.ENDING)
            run, state = self._run, self._state
            if client:
                self._say("asked", f"{name}, by {client}")
        if run is not None and state is State.ARMING:
            run.ask_to_stop()
            return "arming is broken off: the robot sits down and powers off"
        if state is State.ENDING:
            return "the robot is being brought to rest already"
        try:
            return self.ask(name, request, State.ARMED, State.RUNNING, is_stopping=True)
        except Refusal as refusal:
            if refusal.code is not unavailable("").code or run is None:
                raise
            run.ask_to_damp() if is_damping else run.ask_to_stop()
            return "the control process did not read the request, so it was sent a signal"

    def steer(self, request: run_link_pb2.ToRun, identity: str, name: str) -> None:
        """Pass a velocity on; no answer is waited for.

        Args:
            request: The velocity.
            identity: Who steers, by certificate or user; whoever steers keeps others out.
            name: What they call themselves, which tells two of one identity apart.

        Raises:
            Refusal: The policy is not in full control, or somebody else steers.
        """
        with self._lock:
            self._need("velocity", State.RUNNING)
            self._steering.check(identity, name)
            run, mode = self._run, "" if self._run_status is None else self._run_status.mode
            if mode not in ("active", "ramping_in"):
                raise not_now(f"velocity: the policy is not in full control, the mode is {mode or 'not known yet'}")
            self._steering.take(identity, name)
            self._seen()
        if run is None or not run.tell(request):
            raise unavailable("velocity: the control process takes no requests now; the dead-man ends the motion")

    def attend(self) -> None:
        """An operator is there."""
        with self._lock:
            self._seen()
            if self._run is not None and self._state in (State.ARMED, State.RUNNING):
                self._run.tell(run_link_pb2.ToRun(attend=operator_pb2.AttendRequest()))

    # Running ----------------------------------------------------------------------------------------------------------

    def turn(self) -> None:
        """One turn of the service's own loop: read, reap, keep times, feed the watchdog. Call it without pause."""
        run = self._run
        if run is None:
            time.sleep(TURN_S)
            self._look_at_rescue()
        else:
            for message in run.read(TURN_S):
                self._take(message)
            code = run.exit_code()  # known once all that it has said was read
            if code is not None:
                self._reap(run, code)
            else:
                self._keep_times(run)
        if self._state not in (State.ARMED, State.RUNNING):
            self._manager.progressed()

    def begin(self) -> None:
        """Before the first turn: a robot that an earlier service left with power is made safe."""
        with self._lock:
            self._rescue_or_rest()

    def shut_down(self) -> None:
        """End whatever goes on; returns when the robot is at rest, or whatever should see to it has been killed."""
        run = self._run
        if run is not None:
            # The service manager may have sent it the same signal, and a second one would mean damping.
            stop = run_link_pb2.ToRun(stop=operator_pb2.StopRequest())
            if self._state is State.ARMING or (self._state is not State.ENDING and not run.tell(stop)):
                run.ask_to_stop()
        deadline_s = time.monotonic() + self._config.service.arm_timeout_s
        while self._run is not None or self._rescue is not None:
            if self._run is not None and time.monotonic() > deadline_s:
                self._run.kill()
            self.turn()

    def _take(self, message: run_link_pb2.FromRun) -> None:
        kind = message.WhichOneof("what")
        with self._lock:
            if kind == "answer":
                self._waiting.take(message.answer)
            elif kind == "status":
                self._run_status, self._run_told_s = message.status, time.monotonic()
                self._manager.status(f"{self._state.value}: {message.status.mode}, {message.status.policy}")
            elif kind == "event":
                self._record(operator_event(message.event))
            elif kind == "state" and message.state in _STATES:
                if message.state == State.ARMED.value and self._state is State.ARMING:
                    self._seen()
                self._set(State(message.state))
            elif kind == "ended":
                self._ended = message.ended

    def _reap(self, run: RunProcess, code: int) -> None:
        run.close()
        with self._lock:
            outcome = self._ended or operator_pb2.Outcome(
                outcome="control_process_died", exit_code=code, sentence=how_it_died(code)
            )
            outcome.host_stamp_ns = self._clock.now_ns()
            self._last, self._run, self._run_status = outcome, None, None
            self._waiting.let_all_go()
            self._say(
                "ended",
                f"{outcome.outcome}: {outcome.sentence}",
                severity="info" if outcome.exit_code in (0, 10) else "error",
            )
            self._rescue_or_rest()

    def _rescue_or_rest(self) -> None:
        """Idle, unless somebody died with the robot in hand."""
        if not Rescue.is_due(self._robot):
            self._set(State.IDLE)
            return
        spec = RescueSpec(robot=self._robot, config=self._config, lock_step=self._lock_step)
        try:
            self._rescue = Rescue.start(spec)
        except OSError as error:
            self._rescued(is_safe=False, text=f"{MAY_HAVE_POWER}: no process can be started: {error}")
            return
        self._say(
            "make_safe", "a control process died with the robot in hand; the robot is made safe", severity="warning"
        )
        self._set(State.ENDING)

    def _look_at_rescue(self) -> None:
        result = None if self._rescue is None else self._rescue.result()
        if result is not None:
            with self._lock:
                self._rescue = None
                self._rescued(is_safe=result[0], text=result[1])

    def _rescued(self, *, is_safe: bool, text: str) -> None:
        self._say("made_safe" if is_safe else "not_safe", text, severity="warning" if is_safe else "error")
        if self._last is not None:
            self._last.sentence = f"{self._last.sentence}; then: {text}"
        self._set(State.IDLE)

    def _keep_times(self, run: RunProcess) -> None:
        """Abort a control process that hangs, so that it tells where; kill it if that does not end it."""
        if self._state in (State.ARMED, State.RUNNING):
            silent_s = time.monotonic() - max(self._run_told_s, self._state_since_s)
            if silent_s > SILENT_S and not self._is_asked_to_end:
                self._is_asked_to_end = True
                self._say("silent", f"the control process has said nothing for {silent_s:.1f} s", severity="error")
                run.abort()
            if silent_s > SILENT_S + ABORT_TAKES_S:  # stopped or blocked, it has not even seen the abort
                run.kill()
            return
        late_s = time.monotonic() - self._state_since_s - self._config.service.arm_timeout_s
        if late_s > 0.0 and not self._is_asked_to_end:
            self._is_asked_to_end = True
            self._say("late", f"{self._state.value} takes too long; it is broken off", severity="error")
            run.ask_to_stop()
        if late_s > KILL_AFTER_S:
            run.kill()

    # Details ----------------------------------------------------------------------------------------------------------

    def _need(self, name: str, *states: State) -> None:
        if self._state not in states:
            wanted = " or ".join(state.value for state in states)
            raise not_now(f"{name} needs the state {wanted}, and it is {self._state.value}; {self._state.advice}")

    def _set(self, state: State) -> None:
        with self._changed:
            if state is not self._state:
                self._state, self._state_since_s = state, time.monotonic()
                self._say("state", state.value)
                self._manager.status(state.value)
            self._changed.notify_all()

    def _seen(self) -> None:
        self._seen_s = time.monotonic()

    def _say(self, name: str, text: str, *, severity: str = "info") -> None:
        self._record(
            operator_pb2.Event(host_stamp_ns=self._clock.now_ns(), severity=severity, name=f"service_{name}", text=text)
        )

    def _record(self, event: operator_pb2.Event) -> None:
        self.events.add(event)
        self._tell(event)
