"""The robot that the services drive: verbs, one snapshot, two kinds of stream.

Every method may be called from any thread and returns within about one physics step, but for those that say that they
wait.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fake_robot.body.clock import RobotClock
from fake_robot.body.truth import Truth
from fake_robot.eyes.eyes import Eyes
from fake_robot.faults.fault import ServiceFault
from fake_robot.faults.registry import make_fault
from fake_robot.network.requests import CameraView, StandPose, WalkPlan
from fake_robot.network.status import EstopLevel, Snapshot
from fake_robot.network.streams import StateSubscription, spoil
from fake_robot.robot.joint_control import Stream
from fake_robot.robot.real_time import RealTimeLoop
from fake_robot.robot.simulation import Simulation
from fake_robot.robot.snapshot import snapshot_of, truth_of
from fake_robot.robot.streamed_command import CommandRefusedError
from fake_robot.scenario.scenario import Scenario
from spot_model.errors import BadInputError, SpotRlError
from spot_model.robot.facts import NS_PER_S, STATE_PERIOD_NS, Array

_LOGGER = logging.getLogger(__name__)


class TimeModeError(SpotRlError):
    """A call that only makes sense in the other time mode."""


class Robot:
    """A fake Spot without its network. It starts on the ground with its motors off.

    Verbs that the robot cannot follow raise :class:`fake_robot.robot.modes.MotionRefusedError`.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.clock = RobotClock(scenario.clock, is_lock_step=scenario.is_lock_step)
        self._changed = threading.Condition(threading.RLock())
        self._subscriptions: list[StateSubscription] = []
        self.last_command_key = 0
        """Key of the newest submitted command; 0 before the first."""
        self.commands_submitted = 0
        """How many commands were read from command streams."""
        self.last_state_stamp_ns = 0
        """Acquisition stamp of the newest state handed over; 0 before the first."""
        self.states_sent = 0
        """How many states were handed over."""
        self._goal_ns = 0
        self._simulation = Simulation(scenario, self.clock, self._deliver)
        self._loop: RealTimeLoop | None = None
        self._eyes = Eyes(scenario)

    # Life -------------------------------------------------------------------------------------------------------------

    @property
    def is_lock_step(self) -> bool:
        """Whether robot time passes only by :meth:`advance`."""
        return self.scenario.is_lock_step

    def start(self) -> None:
        """Let robot time pass; in lock-step, nothing. Once only: a stopped robot stays so."""
        if self.is_lock_step or self._loop is not None:
            return
        self._loop = RealTimeLoop(
            self._simulation,
            self.clock,
            self._changed,
            max_catch_up_s=self.scenario.real_time.max_catch_up_s,
            on_crash=self._close_states,
        )
        reason = self.why_no_walk()  # loads the policy before robot time begins to pass
        if reason is not None:
            _LOGGER.warning("walking commands will be refused: %s", reason)
        self._loop.start()

    def stop(self) -> None:
        """End; robot time stands still, open streams are closed."""
        if self._loop is not None:
            self._loop.stop()
        self._close_states()
        self._eyes.close()

    @property
    def crash(self) -> BaseException | None:
        """What ended the real-time thread against its will; None while all is well."""
        return None if self._loop is None else self._loop.crash

    # Lock-step --------------------------------------------------------------------------------------------------------

    def advance(self, duration_ns: int) -> None:
        """Let robot time pass, in whole physics steps; what is left over counts for the next time.

        Raises:
            TimeModeError: The robot runs in real time.
        """
        self._check_lock_step()
        with self._changed:
            self._goal_ns = goal_ns = max(self._goal_ns, self._simulation.now_ns) + duration_ns
        while self._simulation.now_ns < goal_ns:
            with self._changed:
                before_ns = self._simulation.now_ns
                # In parts, so that another thread's call never waits for long.
                self._simulation.advance_to(min(goal_ns, before_ns + STATE_PERIOD_NS))
                if self._simulation.now_ns == before_ns:
                    return

    def advance_states(self, count: int, max_duration_ns: int | None = None) -> None:
        """Let robot time pass until ``count`` more states were handed over, or for ``max_duration_ns``.

        By default that is what they take and a second.

        Raises:
            TimeModeError: The robot runs in real time.
        """
        self._check_lock_step()
        goal = self.states_sent + count
        longest_ns = count * STATE_PERIOD_NS + NS_PER_S if max_duration_ns is None else max_duration_ns
        end_ns = self._simulation.now_ns + longest_ns
        while self.states_sent < goal and self._simulation.now_ns < end_ns:
            with self._changed:
                self._simulation.step()

    def wait_for_command_key(self, key: int, timeout_s: float, *, beyond: int = 0) -> bool:
        """Wait, in host time, until a command with this key or a newer one was submitted; False if it never was.

        The first ``beyond`` commands do not count: they were another client's.
        """
        with self._changed:
            return self._changed.wait_for(
                lambda: self.commands_submitted > beyond and self.last_command_key >= key, timeout_s
            )

    # Verbs ------------------------------------------------------------------------------------------------------------

    def power_on(self) -> None:
        """Begin to power the motors."""
        with self._changed:
            self._simulation.modes.power_on()

    def power_off(self) -> None:
        """Cut the motors' power now."""
        with self._changed:
            self._simulation.modes.power_off()

    def stand(self, course: Sequence[StandPose] = ()) -> None:
        """Begin to stand, and then to follow a course of poses; without one, the nominal stand."""
        with self._changed:
            self._simulation.modes.begin("stand", on_feet=True).stand(course)

    def walk(self, plan: WalkPlan) -> None:
        """Begin to walk, from a stand if need be, or go on walking with another plan."""
        with self._changed:
            self._simulation.modes.begin("walk", on_feet=True).walk(plan)

    def place_feet(self, feet_in_odom_m: Array, accuracy_m: float) -> None:
        """Begin to step until the feet stand at these places, shape (4, 2), legs fl, fr, hl, hr."""
        with self._changed:
            self._simulation.modes.begin("stance", on_feet=True).place_feet(feet_in_odom_m, accuracy_m)

    def why_no_walk(self) -> str | None:
        """Why the robot cannot walk by itself at all; None if it can."""
        try:
            self._simulation.walker.load()
        except SpotRlError as error:
            return str(error)
        return None

    def sit(self) -> None:
        """Begin to sit down."""
        with self._changed:
            self._simulation.modes.begin("sit").sit()

    def stop_motion(self) -> None:
        """Stop: from a walk, joint control or freezing back to the vendor's stand; else nothing."""
        with self._changed:
            self._simulation.modes.stop()

    def freeze(self) -> None:
        """Hold every joint where it is."""
        with self._changed:
            self._simulation.modes.begin("freeze").freeze()

    def selfright(self) -> None:
        """Come to a sitting pose from any pose."""
        with self._changed:
            self._simulation.modes.begin("self-right").right()

    def safe_power_off(self) -> None:
        """Sit down, then cut the motors' power."""
        with self._changed:
            self._simulation.modes.safe_power_off()

    def enter_joint_control(self) -> None:
        """Let an open command stream, or the next one, move the joints."""
        with self._changed:
            self._simulation.modes.begin("joint control", on_feet=True).enter_joint_control()

    def set_estop_level(self, level: EstopLevel) -> None:
        """Obey the e-stop."""
        with self._changed:
            self._simulation.modes.set_estop_level(level)

    def clear_behavior_fault(self, fault_id: int) -> bool:
        """Clear a behaviour fault; False if it is not there or cannot be cleared."""
        with self._changed:
            return self._simulation.modes.clear_behavior_fault(fault_id)

    # Streams ----------------------------------------------------------------------------------------------------------

    def open_command_stream(self, on_failure: Callable[[], None]) -> Stream:
        """Open a joint-control stream; ``on_failure`` is called, and must not block, when it has to end."""
        with self._changed:
            stream = Stream(self._simulation.now_ns, on_failure, self._simulation.n_joints)
            self._simulation.joint_control.streams.append(stream)
        return stream

    def submit(self, stream: Stream, request: Any) -> None:
        """Take a ``JointControlStreamRequest`` that was sent now: check it, and let it travel to the servos."""
        with self._changed:
            if stream.failure is not None:
                return
            now_ns = self.clock.elapsed_ns()
            try:
                command = stream.grammar.read(request)
                self.last_command_key = command.key
                self.commands_submitted += 1
                # What is over by now is so when it arrives, too; told now, a client that has closed its end hears it.
                self._simulation.joint_control.check_end_time(command, now_ns)
            except CommandRefusedError as error:
                stream.fail(error.failure)
                self.close_stream(stream)
            else:
                self._simulation.send_command(stream, command, now_ns)
            self._changed.notify_all()

    def submit_to_open_stream(self, request: Any) -> None:
        """Take a request as if it came on the stream that was opened last; where none is open, it is lost."""
        with self._changed:
            streams = self._simulation.joint_control.streams
            if streams:
                self.submit(streams[-1], request)

    def close_stream(self, stream: Stream) -> None:
        """The client ended a stream, or is gone. Its last command stays in effect until its end time."""
        with self._changed:
            self._simulation.joint_control.forget(stream)

    def subscribe_state(self) -> StateSubscription:
        """Open a state stream: every message that reaches the client from now on."""
        subscription = StateSubscription(self._forget)
        with self._changed:
            self._subscriptions.append(subscription)
        return subscription

    # Faults -----------------------------------------------------------------------------------------------------------

    def inject(self, name: str, parameters: Mapping[str, float | str], duration_s: float | None) -> int:
        """Make a fault happen now, for a while or until it is cleared; returns its number. Raises BadInputError."""
        fault = make_fault(name, parameters)
        if isinstance(fault, ServiceFault):
            raise BadInputError(f"fault {name} is one of the services, not of the body; inject it by the admin service")
        with self._changed:
            return self._simulation.inject(fault, duration_s)

    def clear_faults(self, fault_ids: tuple[int, ...] = ()) -> tuple[int, ...]:
        """End injected faults (all, if empty); returns the numbers of those that ended."""
        with self._changed:
            return tuple(self._simulation.clear_faults(fault_ids))

    def active_faults(self) -> Mapping[int, str]:
        """Number and name of every injected fault that is not over."""
        with self._changed:
            return {active.fault_id: active.fault.name for active in self._simulation.faults.active}

    # Seen from outside ------------------------------------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """How the robot reports itself now: as in its newest state message."""
        with self._changed:
            return snapshot_of(self._simulation, self.clock)

    def truth(self, *, reset_extremes: bool = False) -> Truth:
        """The simulated body as it is."""
        with self._changed:
            truth = truth_of(self._simulation, self.clock)
            if reset_extremes:
                self._simulation.extremes.reset()
            return truth

    def see(self, view: CameraView) -> NDArray[Any] | None:
        """What a camera sees now; None where this computer cannot draw it. See :meth:`.Eyes.look`."""
        with self._changed:
            body = self._simulation.body
            position = np.concatenate([body.base_position_m, body.base_wxyz, body.joint_position_rad])
        return self._eyes.look(position, view)

    # Private ----------------------------------------------------------------------------------------------------------

    def _deliver(self, stamp_ns: int, message: bytes) -> None:
        self.states_sent += 1
        self.last_state_stamp_ns = stamp_ns
        kind = self._simulation.faults.effects.malformed_states
        spoilt = spoil(message, kind) if kind else message
        for subscription in tuple(self._subscriptions):
            subscription.put(spoilt)

    def _close_states(self) -> None:
        with self._changed:
            subscriptions = list(self._subscriptions)
        for subscription in subscriptions:
            subscription.close()

    def _forget(self, subscription: StateSubscription) -> None:
        with self._changed:
            if subscription in self._subscriptions:
                self._subscriptions.remove(subscription)

    def _check_lock_step(self) -> None:
        if not self.is_lock_step:
            raise TimeModeError("the robot runs in real time; set time_mode: lock_step in the scenario to step it")
