"""Faults of what the robot measures."""

from __future__ import annotations

from typing import ClassVar, Final, Literal

from pydantic import Field
from typing_extensions import override

from fake_robot.body.fault_effects import FaultEffects
from fake_robot.faults.fault import Fault

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


class FrozenSensors(Fault):
    """Every measured value stays as it was; the stamps go on."""

    name: ClassVar[str] = "frozen_sensors"

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.is_frozen = True


class NanSensor(Fault):
    """One measured signal is NaN."""

    name: ClassVar[str] = "nan_sensor"
    signal: Literal[
        "position", "velocity", "load", "attitude", "body_position", "body_velocity", "body_angular_velocity", "imu"
    ] = Field(description=f"which: {', '.join(_SIGNALS)}")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.nan_signals = (*effects.nan_signals, _SIGNALS[self.signal])


class BadQuaternion(Fault):
    """The attitude's quaternion has not length 1."""

    name: ClassVar[str] = "bad_quaternion"
    scale: float = Field(default=0.0, ge=0.0, le=100.0, description="its length; 0 for all zeros")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.quaternion_scale = self.scale
