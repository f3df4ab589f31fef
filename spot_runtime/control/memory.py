"""What one step of control remembers and gives, and the schedule of the policy's ticks. All of it is frozen."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Final, NamedTuple

import numpy as np

from spot_log.format.events import EventName
from spot_log.format.records import EventRecord
from spot_model.policy.policy import Policy, TickMemory, TickResult
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.state import Gains, JointCommand, RobotState
from spot_runtime.config import HandoverConfig, RunConfig
from spot_runtime.control.modes import Mode
from spot_runtime.control.safety.commands import SetpointMemory
from spot_runtime.control.safety.signals.check import SignalMemory
from spot_runtime.control.safety.signals.readers import Doubt
from spot_runtime.control.safety.watchdogs import WatchMemory
from spot_runtime.control.set_point import LoadAverage, Setpoint
from spot_runtime.control.snapshot import Phase
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.sources import Wanted
from spot_runtime.stops import Ending, Stop


class TickSchedule(NamedTuple):
    """An absolute schedule over acquisition stamps: due instants lie a period apart, whatever the jitter.

    On the 3 ms stream a 20 ms period gives steps of 7, 7 and 6 messages: exactly 50 Hz on average.
    """

    period_ns: int
    next_due_robot_ns: int | None = None
    """None before the first state."""
    ticks: int = 0

    def advance(self, robot_stamp_ns: int) -> tuple[TickSchedule, bool, int]:
        """Look at one state's stamp.

        Returns:
            The new schedule, whether a tick is due on this state, and how many ticks were lost just before it.
        """
        if self.next_due_robot_ns is None:
            return TickSchedule(self.period_ns, robot_stamp_ns + self.period_ns, 1), True, 0
        late_ns = robot_stamp_ns - self.next_due_robot_ns
        if late_ns < 0:
            return self, False, 0
        lost = late_ns // self.period_ns
        due = self.next_due_robot_ns + (lost + 1) * self.period_ns
        return TickSchedule(self.period_ns, due, self.ticks + 1), True, lost


def schedule_for(rate_hz: float) -> TickSchedule:
    """A schedule for a policy's rate."""
    return TickSchedule(round(1e9 / rate_hz))


NOTHING_ASKED: Final = np.zeros(3)
NOTHING_ASKED.flags.writeable = False


class Plan(NamedTuple):
    """What stays the same from the first step to the last."""

    config: RunConfig
    policy: Policy
    policy_gains: Gains
    wanted_at: Callable[[float, int], Wanted]
    """What is asked of the policy, from seconds in full control and the host's clock."""
    wall_s: Callable[[], float]
    """Measures how long the policy computes; decides nothing."""
    limits: SafetyLimits
    """Those of the configuration, for this policy's rate."""
    refusal: Stop | None = None
    """Why this policy must not have the joints."""

    @property
    def observation_fields(self) -> tuple[str, ...]:
        """Names of what the policy observes."""
        return tuple(name for name, _ in self.policy.contract.observation_layout)

    @property
    def rest(self) -> Array:
        """The command that asks for nothing."""
        return np.zeros(len(self.policy.command_low))


class Drive(NamedTuple):
    """What is asked of the joints."""

    hold: Setpoint | None = None
    """The pose in which the vendor's stand handed over; None before."""
    current: Setpoint | None = None
    """What is sent until the next tick."""
    requested_rad: Array = facts.DEFAULT_POSITION_RAD
    """What ``current`` would be without limits. Shape (12,)."""
    limits: SetpointMemory = SetpointMemory()
    policy: TickMemory = TickMemory()
    command: Array = NOTHING_ASKED
    """Asked of the policy: V_x, V_y (m/s), ω_z (rad/s), shape (3,); of a joint script, offsets in rad, shape (12,)."""
    fade_from: Array = NOTHING_ASKED
    """The command at which a soft stop began."""


class Memory(NamedTuple):
    """What one step leaves for the next."""

    phase: Phase
    handover: HandoverConfig
    schedule: TickSchedule
    loads: LoadAverage
    ending: Ending | None = None
    watch: WatchMemory = WatchMemory()
    drive: Drive = Drive()
    told: frozenset[tuple[EventName, str]] = frozenset()
    """Once-only events that have been reported, and what they were about."""
    key: int = 0
    """Key of the newest command."""
    sent_ns: int = 0
    """When it was made, robot clock."""
    signals: SignalMemory = SignalMemory()
    """What the checks of the robot's signals remember."""
    found: tuple[Doubt, ...] = ()
    """What they found since the last step."""


class Act(Enum):
    """What a step wants done beside sending its command."""

    BEGIN = "open the command stream with this step's command"
    END = "ask the vendor's stand to take the joints back"
    RELEASE = "send nothing more"
    ESTOP = "press the e-stop"


class Tick(NamedTuple):
    """A policy period that has begun."""

    number: int
    state: RobotState
    lost: int
    """Periods that passed without a tick just before."""
    result: TickResult | None
    """None where the mode runs no policy."""
    inference_s: float = 0.0
    """Time that the policy took."""


class Step(NamedTuple):
    """What one step gives."""

    memory: Memory
    acts: tuple[Act, ...] = ()
    events: tuple[EventRecord, ...] = ()
    command: JointCommand | None = None
    usable: tuple[RobotState, ...] = ()
    """The usable states among those that have arrived, oldest first."""
    tick: Tick | None = None

    @property
    def newest(self) -> RobotState | None:
        """The newest usable state."""
        return self.usable[-1] if self.usable else None


def first_memory(plan: Plan, robot_ns: int) -> Memory:
    """The memory of a robot that stands under the vendor's control."""
    handover = plan.config.handover
    schedule = schedule_for(plan.policy.contract.rate_hz)
    drive = Drive(command=plan.rest, fade_from=plan.rest)
    return Memory(Phase(Mode.READY, robot_ns), handover, schedule, LoadAverage.over(handover.settle_s), drive=drive)
