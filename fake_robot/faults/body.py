"""Faults of power, motors and motion, and of what the robot measures."""

from __future__ import annotations

from typing import Any, Final, Literal

import numpy as np
from pydantic import Field
from typing_extensions import override

from fake_robot.body.fault_effects import FaultEffects
from fake_robot.faults.fault import Fault
from fake_robot.network.status import SystemFault
from fake_robot.scenario.parts import JointName
from spot_model.robot.facts import JOINT_NAMES


class LowBattery(Fault, name="low_battery"):
    """The battery reports this state of charge."""

    percent: float = Field(default=3.0, ge=0.0, le=100.0, description="state of charge, %")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.battery_percent = self.percent


class BatteryFault(Fault, name="battery_fault"):
    """The battery is faulty: a critical system fault, with which the motors do not power on."""

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.system_faults.append(
            SystemFault("battery_fault", onset_robot_stamp_ns, 1, "battery fault", "critical", ("power",))
        )


class MotorOverTemperature(Fault, name="motor_over_temperature"):
    """A motor reports a temperature; above the scenario's limit that is a critical system fault."""

    joint: JointName = Field(default="fl_kn", description=f"which: {', '.join(JOINT_NAMES)}")
    temperature_c: float = Field(default=110.0, ge=-40.0, le=500.0, description="°C")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.motor_temperature_c[self.joint] = self.temperature_c


class WeakMotor(Fault, name="weak_motor"):
    """A motor gives only part of its torque."""

    joint: JointName = Field(default="fl_kn", description=f"which: {', '.join(JOINT_NAMES)}")
    gain: float = Field(default=0.0, ge=0.0, le=1.0, description="share of the torque; 0 for a dead motor")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.motor_gain[JOINT_NAMES.index(self.joint)] *= self.gain


class SystemFaultRaised(Fault, name="system_fault"):
    """A system fault of your own wording."""

    fault_name: str = Field(default="fake_fault", min_length=1, max_length=100, description="its name")
    message: str = Field(default="", max_length=1000, description="its message")
    severity: Literal["info", "warn", "critical"] = Field(default="warn", description="info, warn or critical")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.system_faults.append(
            SystemFault(self.fault_name, onset_robot_stamp_ns, 0, self.message, self.severity, ())
        )


class BehaviorFaultRaised(Fault, name="behavior_fault"):
    """A behaviour fault: joint control ends, the robot sinks to the ground. It stays until a client clears it."""

    cause: Literal["fall", "hardware", "lease_timeout", "command_failure"] = Field(
        default="hardware", description="fall, hardware, lease_timeout or command_failure"
    )

    @override
    def start(self, simulation: Any) -> None:
        simulation.modes.add_behavior_fault(self.cause, "injected")


class PowerLoss(Fault, name="power_loss"):
    """The motors' power is cut at once."""

    @override
    def start(self, simulation: Any) -> None:
        simulation.modes.power_off("the motors lost power")


class Push(Fault, name="push"):
    """Somebody pushes the body: its velocity changes at once."""

    forward_m_s: float = Field(default=0.0, ge=-10.0, le=10.0, description="along the world's x, m/s")
    left_m_s: float = Field(default=0.0, ge=-10.0, le=10.0, description="along the world's y, m/s")
    up_m_s: float = Field(default=0.0, ge=-10.0, le=10.0, description="m/s")
    roll_rad_s: float = Field(default=0.0, ge=-30.0, le=30.0, description="about the body's x, rad/s")
    pitch_rad_s: float = Field(default=0.0, ge=-30.0, le=30.0, description="about the body's y, rad/s")
    yaw_rad_s: float = Field(default=0.0, ge=-30.0, le=30.0, description="about the body's z, rad/s")

    @override
    def start(self, simulation: Any) -> None:
        simulation.body.push(
            np.array([self.forward_m_s, self.left_m_s, self.up_m_s]),
            np.array([self.roll_rad_s, self.pitch_rad_s, self.yaw_rad_s]),
        )


_SIGNALS: Final = {
    "position": "position_rad",
    "velocity": "velocity_rad_s",
    "load": "load_nm",
    "attitude": "world_from_body_wxyz",
    "body_position": "position_of_body_in_world_m",
    "body_velocity": "linear_vel_of_body_in_world_m_s",
    "body_angular_velocity": "angular_vel_of_body_in_world_rad_s",
    "imu": "imu_acceleration_m_s2",
}


class FrozenSensors(Fault, name="frozen_sensors"):
    """Every measured value stays as it was; the stamps go on."""

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.is_frozen = True


class NanSensor(Fault, name="nan_sensor"):
    """One measured signal is NaN."""

    signal: Literal[
        "position", "velocity", "load", "attitude", "body_position", "body_velocity", "body_angular_velocity", "imu"
    ] = Field(description=f"which: {', '.join(_SIGNALS)}")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.nan_signals = (*effects.nan_signals, _SIGNALS[self.signal])


class BadQuaternion(Fault, name="bad_quaternion"):
    """The attitude's quaternion has not length 1."""

    scale: float = Field(default=0.0, ge=0.0, le=100.0, description="its length; 0 for all zeros")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.quaternion_scale = self.scale
