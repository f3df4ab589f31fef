"""The idle service: it holds no lease and commands nothing; each arming is a process of its own that it looks after.

    idle ──► arming ──► armed ◄──► running ──► ending ──► idle

A control process that dies while it holds the robot leaves a note; then another process makes the robot safe first.
The service manager's watchdog is fed by the control process while that is answerable for the robot (armed, running),
and otherwise by each turn of this object's own loop.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent import futures
from typing import Final

from spot_log.format import codec
from spot_log.format.records import EventRecord, Severity
from spot_protos import operator_pb2, run_link_pb2
from spot_runtime.config import RunConfig
from spot_runtime.control.modes import Mode
from spot_runtime.host.clock import HostClock
from spot_runtime.host.service_manager import ServiceManager
from spot_runtime.operator.door.access import Refusal, not_now, unavailable
from spot_runtime.operator.run.run_spec import RunSpec
from spot_runtime.operator.server.armed_run import ArmedRun, SteeringRight
from spot_runtime.operator.server.policy_folder import OfferedPolicy, PolicyFolder
from spot_runtime.operator.server.run_process import Rescue, RunProcess
from spot_runtime.operator.server.service_state import ServiceState, State
from spot_runtime.rescue.make_safe import MAY_HAVE_POWER

TURN_S: Final = 0.05
ANSWER_TIMEOUT_S: Final = 25.0
"""Opening a log may take 20 s on a bad disk."""
STOP_TIMEOUT_S: Final = 0.3
"""After this a stop is also sent as a signal; the loop answers within a cycle."""

MAX_WAITING: Final = 8
"""Each holds a thread of the service, and one must be left for a stop."""

_STATES: Final = {state.value: state for state in State}


class Supervisor:
    """What the service knows and does; its methods may be called from any thread."""

    def __init__(
        self,
        robot: str,
        config: RunConfig,
        *,
        manager: ServiceManager,
        tell: Callable[[EventRecord], None],
        lock_step: str = "",
    ) -> None:
        """Begin idle. ``tell`` is also told of every event, and must not block."""
        self._robot, self._config, self._lock_step = robot, config, lock_step
        self._manager = manager
        self.policies = PolicyFolder(config.service)
        self._clock = HostClock()
        self._at = ServiceState(manager, tell)
        self._lock, self.events = self._at.lock, self._at.events
        self._run: ArmedRun | None = None
        self._rescue: Rescue | None = None
        self._last: operator_pb2.Outcome | None = None
        self._steering = SteeringRight()
        self._seen_s = 0.0

    # Looking ----------------------------------------------------------------------------------------------------------

    @property
    def state(self) -> State:
        """Where the service stands."""
        return self._at.now

    def status(self) -> operator_pb2.Status:
        """Everything an operator wants to see."""
        now_s = time.monotonic()
        with self._lock:
            status = operator_pb2.Status(
                state=self._at.now.value,
                robot=self._robot,
                host_stamp_ns=self._clock.now_ns(),
                attendance_left_s=-1.0,
                events=self.events.count,
            )
            if self._run is not None and self._run.status is not None:
                status.run.CopyFrom(self._run.status)
                status.run_age_s = self._run.silent_s
            if self._last is not None:
                status.last.CopyFrom(self._last)
            if self._at.now in (State.ARMED, State.RUNNING):
                status.attendance_left_s = self._config.service.attendance_s - (now_s - self._seen_s)
            status.steered_by = self._steering.holder
            return status

    # Asking -----------------------------------------------------------------------------------------------------------

    def arm(self, policy: OfferedPolicy, labels: dict[str, str], operator: str) -> str:
        """Begin to arm, and wait until the robot stands. Returns what was done. Raises Refusal."""
        with self._lock:
            self._at.need("arm", State.IDLE)
            spec = RunSpec(
                robot=self._robot,
                config=self._config,
                policy=policy.path.absolute(),
                policy_sha256=policy.sha256,
                labels={**labels, **({"operator": operator} if operator else {})},
                lock_step=self._lock_step,
            )
            try:
                run = self._run = ArmedRun(RunProcess.start(spec))
            except OSError as error:
                raise unavailable(f"the control process cannot be started: {error}; see to this computer") from error
            self._at.set(State.ARMING)
            self._seen()
            self._at.say("arming", f"policy {policy.name}" + (f", asked by {operator}" if operator else ""))
            while self._run is run and self._at.now in (State.ARMING, State.ENDING):
                self._at.wait_for_change(1.0)
            if self._run is run:
                return (
                    f"the robot stands under the vendor's control; policy {policy.name} waits for 'spot-rl ctl start'"
                )
            why = self._last.sentence if self._last is not None else "the control process ended"
            raise not_now(f"arming did not succeed: {why}")

    def ask(self, name: str, request: run_link_pb2.ToRun, *states: State, is_stopping: bool = False) -> str:
        """Pass a request on to the control process and wait for its answer. Returns its words. Raises Refusal."""
        with self._lock:
            self._at.need(name, *states)
            run = self._run
            if run is None:
                raise not_now(f"{name} needs a control process, and there is none; {self._at.now.advice}")
            if len(run.waiting) >= MAX_WAITING and not is_stopping:
                raise unavailable(f"{name}: {MAX_WAITING} requests wait for their answers already; wait for one")
            waiting = run.waiting.add(request)
            self._seen()
        try:
            if not run.process.tell(request):
                raise unavailable(f"{name}: the control process takes no requests now; stop it, or see its journal")
            answer = waiting.result(STOP_TIMEOUT_S if is_stopping else ANSWER_TIMEOUT_S)
        except (TimeoutError, futures.TimeoutError, futures.CancelledError):
            raise unavailable(f"{name}: the control process gave no answer; see status and journal") from None
        finally:
            with self._lock:
                run.waiting.forget(request.request_id)
        if not answer.is_done:
            raise not_now(f"{name}: {answer.text}")
        return answer.text

    def end(self, name: str, request: run_link_pb2.ToRun, client: str, *, is_damping: bool) -> str:
        """Stop or damp, also when the control process does not read its socket: then by signals."""
        with self._lock:
            self._at.need(name, State.ARMING, State.ARMED, State.RUNNING, State.ENDING)
            run, state = self._run, self._at.now
            if client:
                self._at.say("asked", f"{name}, by {client}")
        if run is not None and state is State.ARMING:
            run.signal_stop()
            return "arming is broken off; a robot that has power already sits down and loses it"
        if state is State.ENDING and is_damping:
            raise not_now(
                f"{name}: the policy has the joints no more; the vendor's controller lets the robot sit and cuts the "
                "power, which the e-stop alone does sooner"
            )
        if state is State.ENDING:
            return "the robot is being brought to rest already"
        try:
            return self.ask(name, request, State.ARMED, State.RUNNING, is_stopping=True)
        except Refusal as refusal:
            if refusal.code is not unavailable("").code or run is None:
                raise
            run.process.ask_to_damp() if is_damping else run.signal_stop()
            return "the control process did not read the request, so it was sent a signal"

    def steer(self, request: run_link_pb2.ToRun, identity: str, name: str) -> None:
        """Pass a velocity on; no answer is waited for.

        Whoever steers keeps others out; ``identity`` is the certificate or user, ``name`` what they call themselves,
        which tells two of one identity apart.

        Raises:
            Refusal: The policy is not in full control, or somebody else steers.
        """
        with self._lock:
            self._at.need("velocity", State.RUNNING)
            self._steering.check(identity, name)
            run = self._run
            mode = "" if run is None else run.mode
            if mode != Mode.ACTIVE.value:  # in any other, the control process would not follow
                raise not_now(f"velocity: the policy is not in full control, the mode is {mode or 'not known yet'}")
            self._steering.take(identity, name)
            self._seen()
        if run is None or not run.process.tell(request):
            raise unavailable("velocity: the control process takes no requests now; the dead-man ends the motion")

    def attend(self) -> None:
        """An operator is there."""
        with self._lock:
            self._seen()
            if self._run is not None and self._at.now in (State.ARMED, State.RUNNING):
                self._run.process.tell(run_link_pb2.ToRun(attend=operator_pb2.AttendRequest()))

    # Running ----------------------------------------------------------------------------------------------------------

    def turn(self) -> None:
        """One turn of the service's own loop: read, reap, keep times, feed the watchdog. Call it without pause."""
        run = self._run
        if run is None:
            time.sleep(TURN_S)
            self._look_at_rescue()
        else:
            for message in run.process.read(TURN_S):
                self._take(message)
            code = run.process.exit_code()  # known once all that it has said was read
            if code is not None:
                self._reap(run, code)
            else:
                told = run.keep_times(self._at.now, self._at.since_s, self._config.service.arm_timeout_s)
                if told is not None:
                    self._at.say(*told, severity=Severity.ERROR)
        if self._at.now not in (State.ARMED, State.RUNNING):
            self._manager.progressed()

    def adopt(self, process: RunProcess, state: State) -> None:
        """Look after a control process that is there already."""
        with self._lock:
            self._run = ArmedRun(process)
            self._at.set(state)

    def begin(self) -> None:
        """Before the first turn: a robot that an earlier service left with power is made safe."""
        with self._lock:
            self._rescue_or_rest()

    def estop(self) -> None:
        """Have the control process press the e-stop, if there is one; may be called in a signal's handler."""
        run = self._run
        if run is not None:
            run.process.press_estop()

    def shut_down(self) -> None:
        """End whatever goes on; returns when the robot is at rest, or whatever should see to it has been killed.

        A process that waits for a lease of somebody else's is not waited for: it outlives this one.
        """
        run = self._run
        if run is not None:
            # The service manager may have sent it the same signal, and a second one would mean damping.
            stop = run_link_pb2.ToRun(stop=operator_pb2.StopRequest())
            if self._at.now is State.ARMING or (self._at.now is not State.ENDING and not run.process.tell(stop)):
                run.signal_stop()
        deadline_s = time.monotonic() + self._config.service.arm_timeout_s
        while self._run is not None or (self._rescue is not None and not self._rescue.waits):
            if self._run is not None and time.monotonic() > deadline_s:
                self._run.process.kill()
            self.turn()

    def _take(self, message: run_link_pb2.FromRun) -> None:
        kind = message.WhichOneof("what")
        with self._lock:
            if self._run is not None:
                self._run.take(message)
            if kind == "status":
                self._manager.status(f"{self._at.now.value}: {message.status.mode}, {message.status.policy}")
            elif kind == "event":
                self._at.record(codec.event_from_proto(message.event))
            elif kind == "state" and message.state in _STATES:
                if message.state == State.ARMED.value and self._at.now is State.ARMING:
                    self._seen()
                self._at.set(_STATES[message.state])

    def _reap(self, run: ArmedRun, code: int) -> None:
        run.process.close()
        with self._lock:
            outcome = run.outcome(code)
            outcome.host_stamp_ns = self._clock.now_ns()
            self._last, self._run = outcome, None
            self._at.say(
                "ended",
                f"{outcome.outcome}: {outcome.sentence}",
                severity=Severity.INFO if outcome.exit_code in (0, 10) else Severity.ERROR,
            )
            self._rescue_or_rest()

    def _rescue_or_rest(self) -> None:
        """Go idle, unless a control process died while it held the robot."""
        if not Rescue.is_due(self._robot):
            self._at.set(State.IDLE)
            return
        try:
            self._rescue = Rescue.start(self._robot, self._config, self._lock_step)
        except OSError as error:
            self._rescued(is_safe=False, text=f"{MAY_HAVE_POWER}: no process can be started: {error}")
            return
        self._at.say(
            "make_safe",
            "a control process ended with the robot in hand; the robot is made safe",
            severity=Severity.WARNING,
        )
        self._at.set(State.ENDING)

    def _look_at_rescue(self) -> None:
        rescue = self._rescue
        if rescue is None:
            return
        before, result = rescue.waits, rescue.result()
        with self._lock:
            if result is not None:
                self._rescue = None
                self._rescued(is_safe=result[0], text=result[1])
            elif rescue.waits not in ("", before):
                self._at.say("make_safe", rescue.waits, severity=Severity.ERROR)

    def _rescued(self, *, is_safe: bool, text: str) -> None:
        name, severity = ("made_safe", Severity.WARNING) if is_safe else ("not_safe", Severity.ERROR)
        self._at.say(name, text, severity=severity)
        if self._last is not None:
            self._last.sentence = f"{self._last.sentence}; then: {text}"
        self._at.set(State.IDLE)

    def _seen(self) -> None:
        self._seen_s = time.monotonic()
