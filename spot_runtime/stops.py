"""Why a run can end: one closed table of reasons, each with its reaction, exit code and words."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Final, NamedTuple

from spot_log.format.events import EventName
from spot_runtime.causes import shortage

CRITICAL: Final = "critical: "
"""Prefix of a system fault that must end a run."""


class Reaction(Enum):
    """What is done with the robot, mildest first."""

    HAND_BACK = "stop in place, hand back to the vendor's stand, sit, power off"
    DAMP = "joints damped until the body rests, then power off"
    EXPIRE = "nothing more is sent, the last command expires, then power off"
    ESTOP = "joints damped at once, and the motors' power cut by the software e-stop"

    @property
    def level(self) -> int:
        """0 for the mildest; a reaction only ever gives way to a stronger one."""
        return list(Reaction).index(self)


class StopRule(NamedTuple):
    """One row of the table."""

    reaction: Reaction
    exit_code: int
    text: str
    next_step: str


class StopReason(Enum):
    """Every reason for which a run ends. The values are the rows of the table in the documentation."""

    COMPLETED = StopRule(Reaction.HAND_BACK, 0, "the command sequence is done", "")
    OPERATOR_STOP = StopRule(
        Reaction.HAND_BACK, 10, "the operator asked to stop", "when ready, 'spot-rl ctl arm' or 'spot-rl run'"
    )
    OPERATOR_DAMP = StopRule(Reaction.DAMP, 11, "damping was asked for", "check the robot, then start again")
    OPERATOR_ESTOP = StopRule(
        Reaction.ESTOP, 12, "the operator pressed the e-stop", "check the robot, then start again"
    )
    OPERATOR_GONE = StopRule(
        Reaction.HAND_BACK, 13, "no operator attends the robot", "attend it ('spot-rl ctl watch') and start again"
    )
    SERVICE_LOST = StopRule(
        Reaction.HAND_BACK, 14, "the operator's service is gone", "see its journal; it restarts idle"
    )
    UNGUARDED = StopRule(
        Reaction.HAND_BACK, 15, "no guardian watches over this program", "check this computer, then start again"
    )
    PROCESS_PAUSED = StopRule(
        Reaction.DAMP, 16, "this process did not run", "see what stopped it: a signal, a debugger, a sleeping computer"
    )
    STATE_STALE = StopRule(
        Reaction.DAMP,
        20,
        "the newest state is too old",
        "end other programs, or check the link (a slow one: safety.state_age_damp_s); in real time, give a fake robot "
        "--lock-step",
    )
    STATE_LOST = StopRule(Reaction.EXPIRE, 21, "no readable state arrives any more", "check the link to the robot")
    STATE_NOT_FINITE = StopRule(Reaction.DAMP, 22, "a state contains a non-finite value", "check the robot's sensors")
    STATE_FROZEN = StopRule(Reaction.DAMP, 23, "joint values no longer change", "check the robot's sensors")
    STATE_REJECTED = StopRule(
        Reaction.DAMP, 24, "states arrive duplicated or back-dated", "check the link and the robot's clock"
    )
    STATE_ATTITUDE = StopRule(Reaction.DAMP, 25, "the attitude is no rotation", "check the robot's sensors")
    TILT = StopRule(Reaction.DAMP, 26, "the body tilts too far", "set the robot upright; check policy and ground")
    BODY_LOW = StopRule(Reaction.DAMP, 29, "the body is too low", "check policy, ground and payload")
    JOINT_VELOCITY = StopRule(Reaction.DAMP, 27, "a joint is measured too fast", "check policy, ground and sensors")
    JOINT_POSITION = StopRule(Reaction.DAMP, 28, "a joint is measured beyond its stop", "check the robot's calibration")
    ARM_LOST = StopRule(Reaction.DAMP, 54, "the states lack the arm's joints", "see the robot's own page")
    ARM_AWAY = StopRule(Reaction.DAMP, 55, "the arm has left its stowed pose", "see what moved it, then stow it")
    POLICY_NOT_FINITE = StopRule(Reaction.DAMP, 30, "the policy gave a non-finite value", "check the policy file")
    SETPOINT_STEP = StopRule(Reaction.DAMP, 31, "set-points keep jumping", "check the policy's scale and joint order")
    SETPOINT_OVERSHOOT = StopRule(
        Reaction.DAMP, 32, "set-points stay far beyond a joint's stop", "check the policy's scale and joint order"
    )
    TICKS_SKIPPED = StopRule(Reaction.DAMP, 33, "too many policy ticks were lost", "end other programs; see 'doctor'")
    SIGNAL_FROZEN = StopRule(
        Reaction.DAMP, 34, "a signal is frozen although its neighbours move", "check the robot's sensors"
    )
    SIGNALS_CONTRADICT = StopRule(
        Reaction.DAMP,
        35,
        "signals contradict each other",
        "see whether the robot was pushed or slid; if not, check its sensors, motors and joint order",
    )
    POSITION_REFUSED = StopRule(
        Reaction.HAND_BACK,
        39,
        "loads do not fit the positions that joints report",
        "see whether the robot was pushed; if not, check joint order, signs, calibration and load sensors",
    )
    SIGNAL_OUT_OF_RANGE = StopRule(
        Reaction.DAMP, 37, "a signal is beyond the range of a Spot", "check the robot's sensors and units"
    )
    POLICY_OUT_OF_BOUNDS = StopRule(
        Reaction.DAMP, 38, "the policy's contract asks for more than is allowed", "check it, or the keys of 'safety'"
    )
    COMMAND_UNCONFIRMED = StopRule(Reaction.DAMP, 40, "the robot confirms no command", "check the link")
    COMMAND_REFUSED = StopRule(Reaction.EXPIRE, 41, "the robot ended the command stream", "see the robot's message")
    ACTIVATION_FAILED = StopRule(
        Reaction.EXPIRE, 42, "the robot did not enter joint control", "check the joint-control licence and the lease"
    )
    HAND_BACK_FAILED = StopRule(
        Reaction.DAMP, 49, "the vendor's stand did not take the robot back", "see the robot's own page"
    )
    CLOCK_JUMPED = StopRule(
        Reaction.DAMP, 43, "the robot's clock jumped", "start again; in real time, give a fake robot --lock-step"
    )
    LEASE_LOST = StopRule(Reaction.EXPIRE, 44, "the lease was lost", "if nobody took it, it ran out: check the link")
    ESTOPPED = StopRule(Reaction.EXPIRE, 45, "an e-stop is pressed", "release the e-stop, then start again")
    MOTORS_OFF = StopRule(Reaction.EXPIRE, 46, "the motors have no power", "power on, then start again")
    BEHAVIOR_FAULT = StopRule(
        Reaction.DAMP, 47, "the robot reports a behaviour fault", "clear it by hand, then start again"
    )
    LINK_LOST = StopRule(Reaction.DAMP, 48, "the robot no longer answers polls", "check the link")
    BATTERY_LOW = StopRule(Reaction.HAND_BACK, 50, "the battery is low", "charge or change the battery")
    MOTOR_HOT = StopRule(Reaction.HAND_BACK, 51, "a motor is hot", "let the robot cool down")
    SYSTEM_FAULT = StopRule(Reaction.HAND_BACK, 52, "the robot reports a system fault", "see the robot's own page")
    BATTERY_UNKNOWN = StopRule(
        Reaction.HAND_BACK, 53, "battery or temperatures are not known", "see the robot's own page"
    )
    LOG_FAILED = StopRule(Reaction.HAND_BACK, 60, "the log no longer records", "free the disk, then start again")
    COMPUTER_SHORT = StopRule(
        Reaction.DAMP, 61, "this computer gives the program too few files, threads or memory", "raise its limits"
    )
    INTERNAL_ERROR = StopRule(Reaction.DAMP, 70, "a defect of this program", "report it with the log")

    @property
    def label(self) -> str:
        """The name in logs, summaries and file names."""
        return self.name.lower()

    @property
    def reaction(self) -> Reaction:
        """What is done with the robot."""
        return self.value.reaction

    @property
    def is_urgent(self) -> bool:
        """Whether a mild end must be a quick one: the robot sits within two seconds."""
        return self in (StopReason.BATTERY_LOW, StopReason.MOTOR_HOT, StopReason.SYSTEM_FAULT)

    @property
    def is_fault(self) -> bool:
        """Whether something went wrong, rather than an end that somebody wanted."""
        return not (self.exit_code == 0 or self.name in ("OPERATOR_STOP", "OPERATOR_DAMP", "OPERATOR_ESTOP"))

    @property
    def exit_code(self) -> int:
        """The process's exit code."""
        return self.value.exit_code


TOLD_LATER: Final = frozenset({StopReason.TILT, StopReason.OPERATOR_ESTOP})
"""What is told also where something else ended the run."""

WANTED_ENDS: Final = frozenset({StopReason.OPERATOR_STOP.label, StopReason.COMPLETED.label})
"""Labels of the ends that are no incident, so that no flight record is written."""


@dataclass(frozen=True)
class Stop:
    """One stop that happened: the reason with its figures."""

    reason: StopReason
    detail: str = ""
    """What exactly, in words: a joint's name, the robot's own message."""
    values: dict[str, float] = field(default_factory=dict)
    """Measured value, bound and the like, unit in the key."""

    @property
    def event_name(self) -> EventName:
        """What it is in the log: an end that somebody wanted is no error."""
        if self.reason.exit_code == 0:
            return EventName.COMPLETED
        return EventName.STOP_WANTED if self.reason.label in WANTED_ENDS else EventName.STOP

    def sentence(self) -> str:
        """One line for a person: what happened, with which figures, and what to do next."""
        rule = self.reason.value
        figures = ", ".join(f"{name} = {value:g}" for name, value in self.values.items())
        text = rule.text + (f": {self.detail}" if self.detail else "") + (f" ({figures})" if figures else "")
        return f"{text}; {rule.next_step}" if rule.next_step else text


@dataclass(frozen=True)
class Ending:
    """How a run ends: why, and how strongly by now."""

    cause: Stop
    """What began it. A mild end that somebody wanted gives way to whatever comes later; the first fault stays."""
    reaction: Reaction
    """The strongest reaction that any stop has asked for since."""
    later: tuple[Stop, ...] = ()
    """What came after it and is told all the same: that the body tilted too far, that the e-stop was pressed."""


def ending_after(ending: Ending | None, stop: Stop) -> Ending:
    """How a run ends once one more stop is due; the same object where that changes nothing."""
    reaction = stop.reason.reaction
    if ending is None:
        return Ending(stop, reaction)
    gives_way = ending.reaction is Reaction.HAND_BACK and not ending.cause.reason.is_fault
    is_stronger = reaction.level > ending.reaction.level
    if gives_way and (is_stronger or stop.reason.is_fault):
        return Ending(stop, reaction if is_stronger else ending.reaction)
    told = {each.reason for each in (ending.cause, *ending.later)}
    later = (stop,) if stop.reason in TOLD_LATER - told else ()
    if not is_stronger and not later:
        return ending
    return replace(ending, reaction=reaction if is_stronger else ending.reaction, later=ending.later + later)


def unforeseen(error: Exception, doing: str = "") -> Stop:
    """The stop for an error that nobody foresaw: a defect of ours, unless this computer lacks something."""
    words = f"{doing}: " if doing else ""
    words += f"{type(error).__name__}: {error}"
    return Stop(StopReason.COMPUTER_SHORT if shortage(words) else StopReason.INTERNAL_ERROR, words)
