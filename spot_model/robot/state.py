"""Messages of one robot: the state, the joint command, the slow state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.facts import Array


@dataclass(frozen=True)
class ImuPacket:
    """One sample of the body's inertial unit (1 kHz, three in a state message)."""

    robot_stamp_ns: int
    acceleration_of_imu_in_link_m_s2: Array
    """Linear acceleration relative to odom, expressed in the mounting link's frame, as the robot reports it; (3,)."""
    angular_vel_of_link_in_link_rad_s: Array
    """Relative to odom, expressed in the mounting link's frame. Shape (3,)."""
    odom_from_link_wxyz: Array
    """Shape (4,). May be the negative of the body's quaternion: the same rotation."""


@dataclass(frozen=True)
class Measured:
    """What a robot measures at one instant, or, with a row for each, at many. Canonical joint order, SI units, float64.

    Shapes are those of one instant; Spot has J = 12 joints and F = 4 feet.
    """

    position_rad: Array
    """Shape (J,)."""
    velocity_rad_s: Array
    """Shape (J,)."""
    load_nm: Array
    """Torque measured at the joint's output, shape (J,)."""
    position_of_body_in_odom_m: Array
    """Shape (3,). Its z is not the height over ground."""
    odom_from_body_wxyz: Array
    """Shape (4,), scalar first."""
    linear_vel_of_body_in_odom_m_s: Array
    """Shape (3,)."""
    angular_vel_of_body_in_odom_rad_s: Array
    """Shape (3,)."""
    foot_contact: NDArray[np.bool_]
    """Shape (F,), legs fl, fr, hl, hr."""


@dataclass(frozen=True)
class RobotState(Measured):
    """One message of the state stream, 333.33 Hz."""

    robot_stamp_ns: int
    """When the joints were sampled, robot clock."""
    host_stamp_ns: int
    """When the message was received, host clock (UNIX time)."""
    last_command_key: int
    """Key of the newest command that the robot has received; 0 before the first."""
    last_command_robot_stamp_ns: int
    """When the robot received that command, robot clock; 0 before the first."""
    imu: Sequence[ImuPacket] = ()
    arm_position_rad: Sequence[float] = ()
    """Of the seven joints of an arm, as of :mod:`spot_model.robot.arm`; empty for a robot without one."""
    arm_load_nm: Sequence[float] = ()
    """Likewise."""


@dataclass(frozen=True)
class Gains:
    """PD gains of the joint servo, each of shape (12,)."""

    kp_nm_per_rad: Array
    kd_nm_s_per_rad: Array

    @staticmethod
    def policy() -> Gains:
        """The paper's gains: 60 and 1.5 on every joint."""
        return Gains(
            np.full(facts.N_JOINTS, facts.POLICY_KP_NM_PER_RAD), np.full(facts.N_JOINTS, facts.POLICY_KD_NM_S_PER_RAD)
        )

    @staticmethod
    def stand() -> Gains:
        """The gains of the vendor's own stand."""
        return Gains(facts.STAND_KP_NM_PER_RAD.copy(), facts.STAND_KD_NM_S_PER_RAD.copy())


@dataclass(frozen=True)
class JointCommand:
    """PD set-points for the twelve joints, valid until an instant of the robot's clock."""

    key: int
    """Echoed by the robot when it has received the command; > 0 and rising."""
    position_rad: Array
    """Set-point, shape (12,)."""
    velocity_rad_s: Array
    """Set-point, shape (12,); 0 for the paper's policy."""
    load_nm: Array
    """Feed-forward torque, shape (12,); 0 for the paper's policy."""
    gains: Gains
    end_robot_stamp_ns: int
    """The command is void after this instant, robot clock."""


@dataclass(frozen=True)
class SlowState:
    """Battery, temperatures and faults, polled at a few hertz; the state stream has none of them."""

    robot_stamp_ns: int
    host_stamp_ns: int
    motors_powered: bool
    estopped: bool
    battery_charge_percent: float
    """NaN where the robot does not report it."""
    battery_voltage_v: float
    battery_current_a: float
    """Negative while discharging. [sdk]"""
    battery_temperature_c: tuple[float, ...] = ()
    motor_temperature_c: dict[str, float] = field(default_factory=dict)
    """By joint name, where the robot reports one."""
    system_faults: tuple[str, ...] = ()
    behavior_faults: tuple[str, ...] = ()
    service_faults: tuple[str, ...] = ()
