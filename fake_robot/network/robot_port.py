"""What the services see of the robot: a few verbs, one snapshot, two kinds of stream. No gRPC, no physics.

Every method may be called from any thread and returns within about one physics step, but for those that say that they
wait.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from fake_robot.network.camera_view import CameraView
from fake_robot.network.stand_pose import StandPose
from fake_robot.network.walk_plan import WalkPlan, WalkProgress

Array = NDArray[np.float64]


class MotorPower(enum.Enum):
    """State of the motors' supply."""

    OFF = "off"
    POWERING_ON = "powering_on"
    ON = "on"
    POWERING_OFF = "powering_off"
    ERROR = "error"


class Mode(enum.Enum):
    """What the robot is doing."""

    LIMP = "limp"
    """Motors off, or powering."""
    SITTING = "sitting"
    STANDING_UP = "standing_up"
    STANDING = "standing"
    SITTING_DOWN = "sitting_down"
    WALKING = "walking"
    STEPPING = "stepping"
    """Putting its feet to given places."""
    FROZEN = "frozen"
    RIGHTING = "righting"
    JOINT_CONTROL = "joint_control"
    DAMPING = "damping"


class EstopLevel(enum.Enum):
    """What the e-stop demands."""

    NONE = "none"
    SETTLE_THEN_CUT = "settle_then_cut"
    CUT = "cut"


class StanceProgress(enum.Enum):
    """How far the newest stance has come."""

    MOVING = "moving"
    REACHED = "reached"
    TOO_FAR = "too_far"


@dataclass(frozen=True)
class BehaviorFault:
    """Something that went wrong while moving; no command is taken until it is cleared."""

    fault_id: int
    onset_robot_stamp_ns: int
    cause: str
    """``fall``, ``hardware``, ``lease_timeout`` or ``command_failure``."""
    is_clearable: bool = True


@dataclass(frozen=True)
class SystemFault:
    """A hardware or software fault."""

    name: str
    onset_robot_stamp_ns: int
    code: int = 0
    message: str = ""
    severity: str = "warn"
    """``info``, ``warn`` or ``critical``; a critical one keeps the motors from powering on."""
    attributes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Snapshot:
    """The robot at one instant, as it reports itself (with sensor noise). Canonical joint order, SI units."""

    robot_stamp_ns: int
    mode: Mode
    motor_power: MotorPower
    estop_level: EstopLevel
    position_rad: Array
    velocity_rad_s: Array
    load_nm: Array
    position_of_body_in_odom_m: Array
    odom_from_body_wxyz: Array
    position_of_body_in_vision_m: Array
    vision_from_body_wxyz: Array
    linear_vel_of_body_in_odom_m_s: Array
    angular_vel_of_body_in_odom_rad_s: Array
    linear_vel_of_body_in_vision_m_s: Array
    angular_vel_of_body_in_vision_rad_s: Array
    foot_contact: NDArray[np.bool_]
    foot_position_in_body_m: Array
    """Shape (4, 3)."""
    ground_height_in_odom_m: float
    battery_charge_percent: float
    battery_voltage_v: float
    battery_current_a: float
    battery_temperature_c: tuple[float, ...]
    battery_runtime_s: float
    is_battery_missing: bool
    is_on_shore_power: bool
    motor_temperature_c: Mapping[str, float]
    behavior_faults: tuple[BehaviorFault, ...] = ()
    system_faults: tuple[SystemFault, ...] = ()
    distance_m: float = 0.0
    time_moving_s: float = 0.0
    time_powered_s: float = 0.0
    joint_commands_received: int = 0
    is_joint_control_failed: bool = False
    walk_progress: WalkProgress = WalkProgress.NONE
    stance_progress: StanceProgress = StanceProgress.MOVING
    stand_height_m: float = 0.52
    """Height of the body's origin over the ground in the nominal stand."""
    metrics: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class StreamFailure:
    """Why a joint-control stream ended."""

    status: int
    """A ``JointControlStreamResponse.Status``."""
    message: str


class CommandStream(Protocol):
    """One open joint-control stream."""

    def submit(self, request: Any) -> None:
        """Take a ``JointControlStreamRequest`` that arrived now: check it, and queue it with the channel's delay."""

    def failure(self) -> StreamFailure | None:
        """Why the stream has to end; None while all is well."""

    def close(self) -> None:
        """The client ended the stream, or is gone."""


class StateSubscription(Protocol):
    """One open state stream."""

    def get(self, timeout_s: float) -> bytes | None:
        """The next serialised ``RobotStateStreamResponse``; None after ``timeout_s`` without one, or once closed."""

    @property
    def is_closed(self) -> bool:
        """Whether no message will come any more."""

    def close(self) -> None:
        """Send no more. May be called from another thread; a waiting ``get`` returns."""


class RobotClock(Protocol):
    """The robot's own clock."""

    def now_ns(self) -> int:
        """Robot time, nanoseconds since the UNIX epoch plus the robot's skew and drift."""

    def elapsed_ns(self) -> int:
        """Robot time since the start: it goes on evenly when the clock is set."""


@dataclass(frozen=True)
class FaultKind:
    """A fault that can be injected: what it does, and its parameters with their meaning."""

    name: str
    help: str
    parameters: Mapping[str, str] = field(default_factory=dict)


class RobotPort(Protocol):
    """The robot."""

    @property
    def clock(self) -> RobotClock:
        """Its clock."""

    @property
    def is_lock_step(self) -> bool:
        """Whether robot time passes only by ``advance``."""

    def start(self) -> None:
        """Let time pass (in lock-step: be ready to)."""

    def stop(self) -> None:
        """End; joins its threads."""

    @property
    def crash(self) -> BaseException | None:
        """What ended the real-time thread; None while all is well."""

    def snapshot(self) -> Snapshot:
        """How it reports itself now."""

    def power_on(self) -> None:
        """Begin to power the motors."""

    def power_off(self) -> None:
        """Cut the motors' power now."""

    def stand(self, course: Sequence[StandPose] = ()) -> None:
        """Begin to stand, and then to follow a course of poses; without one, the nominal stand."""

    def walk(self, plan: WalkPlan) -> None:
        """Begin to walk, from a stand if need be, or go on walking with another plan."""

    def place_feet(self, feet_in_odom_m: Array, accuracy_m: float) -> None:
        """Begin to step until the feet stand at these places, shape (4, 2), legs fl, fr, hl, hr."""

    def why_no_walk(self) -> str | None:
        """Why the robot cannot walk by itself at all; None if it can."""

    def sit(self) -> None:
        """Begin to sit down."""

    def stop_motion(self) -> None:
        """Stop where it is: from joint control or freezing back to the vendor's stand; else nothing."""

    def freeze(self) -> None:
        """Hold every joint where it is."""

    def selfright(self) -> None:
        """Come to a sitting pose from any pose."""

    def safe_power_off(self) -> None:
        """Sit down, then cut the motors' power."""

    def enter_joint_control(self) -> None:
        """Let an open command stream, or the next one, move the joints."""

    def set_estop_level(self, level: EstopLevel) -> None:
        """Obey the e-stop."""

    def add_behavior_fault(self, cause: str) -> None:
        """Raise a behaviour fault."""

    def clear_behavior_fault(self, fault_id: int) -> bool:
        """Clear a behaviour fault; False if it is not there or cannot be cleared."""

    def open_command_stream(self, on_failure: Callable[[], None]) -> CommandStream:
        """Open a joint-control stream; ``on_failure`` is called (from any thread) when it has to end."""

    def submit_to_open_stream(self, request: Any) -> None:
        """Take a ``JointControlStreamRequest`` as if it came on the stream that was opened last, if that is open."""

    def subscribe_state(self) -> StateSubscription:
        """Open a state stream."""

    def advance(self, duration_ns: int) -> None:
        """Lock-step: let so much robot time pass."""

    def advance_states(self, count: int, max_duration_ns: int | None = None) -> None:
        """Lock-step: let time pass until ``count`` more states were handed over, or for a maximum of robot time."""

    def wait_for_command_key(self, key: int, timeout_s: float, *, beyond: int = 0) -> bool:
        """Wait, in host time, until a command with this key or a newer one came after the first ``beyond``."""

    @property
    def last_command_key(self) -> int:
        """Key of the newest submitted command; 0 before the first."""

    @property
    def commands_submitted(self) -> int:
        """How many commands were submitted."""

    @property
    def last_state_stamp_ns(self) -> int:
        """Acquisition stamp of the newest state handed to a stream; 0 before the first."""

    @property
    def states_sent(self) -> int:
        """How many states were handed over."""

    def fault_kinds(self) -> tuple[FaultKind, ...]:
        """The faults that ``inject`` knows."""

    def inject(self, name: str, parameters: Mapping[str, float | str], duration_s: float | None) -> int:
        """Make a fault happen; returns its number. Raises BadInputError for a name or parameter it does not know."""

    def clear_faults(self, fault_ids: tuple[int, ...]) -> tuple[int, ...]:
        """End injected faults (all, if empty); returns the numbers of those that ended."""

    def active_faults(self) -> Mapping[int, str]:
        """Number and name of every injected fault."""

    def see(self, view: CameraView) -> NDArray[Any] | None:
        """What a camera sees now, shape (rows, cols), grey or mm of depth; None where nothing can draw it. Waits."""

    def truth(self, *, reset_extremes: bool = False) -> Any:
        """The simulated body as it is, without delay or noise."""
