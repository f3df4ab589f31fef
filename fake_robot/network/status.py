"""How the robot reports itself: one snapshot, and the words that it uses. No gRPC, no physics."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fake_robot.network.requests import WalkProgress

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
    arm: Array = field(default_factory=lambda: np.empty((3, 0)))
    """Positions, velocities and loads of an arm's joints, shape (3, 7); without one, (3, 0)."""


@dataclass(frozen=True)
class StreamFailure:
    """Why a joint-control stream ended."""

    status: int
    """A ``JointControlStreamResponse.Status``."""
    message: str
