"""Faults of the body, by name: what can be made to go wrong while the robot runs.

A fault acts for a while, or until it is cleared. Most change the :class:`Knobs`, which are summed up anew whenever a
fault comes or goes; a few do something once, at their start. What only the network or the services can do (tokens,
leases, e-stop buttons, closed streams, reboots) is theirs.
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal, Protocol

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from fake_robot.knobs import Knobs
from fake_robot.robot_port import SystemFault
from fake_robot.scenario_parts import JointName
from spot_model.errors import BadInputError
from spot_model.facts import JOINT_NAMES
from spot_model.facts import Array as _Array
from spot_model.validation import explain


class Victim(Protocol):
    """What a fault may do once."""

    def push(self, linear_velocity_m_s: _Array, angular_velocity_rad_s: _Array) -> None:
        """Add to the body's velocity."""

    def lose_power(self, reason: str) -> None:
        """Cut the motors' power now."""

    def fail_behavior(self, cause: str, message: str) -> None:
        """Raise a behaviour fault."""


class Fault(BaseModel):
    """Base of all faults; the fields are its parameters."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    name: ClassVar[str]

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        """Add to what is changed, as long as the fault is active."""

    def start(self, victim: Victim) -> None:
        """Do something once."""


class StateGap(Fault):
    """No state message is sent; those of this time are lost."""

    name: ClassVar[str] = "state_gap"

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        knobs.has_state_gap = True


class StateDelay(Fault):
    """State messages take longer, all alike."""

    name: ClassVar[str] = "state_delay"
    delay_s: float = Field(ge=0.0, le=10.0, description="added delay, s")

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        knobs.state_delay_s += self.delay_s


class CommandDelay(Fault):
    """Commands take longer, all alike."""

    name: ClassVar[str] = "command_delay"
    delay_s: float = Field(ge=0.0, le=10.0, description="added delay, s")

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        knobs.command_delay_s += self.delay_s


class StateJitter(Fault):
    """State messages take longer, each by its own exponential draw."""

    name: ClassVar[str] = "state_jitter"
    mean_s: float = Field(ge=0.0, le=1.0, description="mean of the added delay, s")

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        knobs.state_jitter_s += self.mean_s


class CommandJitter(Fault):
    """Commands take longer, each by its own exponential draw."""

    name: ClassVar[str] = "command_jitter"
    mean_s: float = Field(ge=0.0, le=1.0, description="mean of the added delay, s")

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        knobs.command_jitter_s += self.mean_s


class StateDrops(Fault):
    """Some state messages are lost."""

    name: ClassVar[str] = "state_drops"
    probability: float = Field(ge=0.0, le=1.0, description="share of messages")

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        knobs.state_drop_probability = 1.0 - (1.0 - knobs.state_drop_probability) * (1.0 - self.probability)


class CommandDrops(Fault):
    """Some commands are lost on their way."""

    name: ClassVar[str] = "command_drops"
    probability: float = Field(ge=0.0, le=1.0, description="share of messages")

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        knobs.command_drop_probability = 1.0 - (1.0 - knobs.command_drop_probability) * (1.0 - self.probability)


class DuplicatedStates(Fault):
    """Some state messages are sent twice."""

    name: ClassVar[str] = "duplicated_states"
    probability: float = Field(default=0.2, ge=0.0, le=1.0, description="share of messages")

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        knobs.duplicate_probability = max(knobs.duplicate_probability, self.probability)


class BackDatedStates(Fault):
    """Some state messages bear the stamps of an earlier time."""

    name: ClassVar[str] = "back_dated_states"
    probability: float = Field(default=0.2, ge=0.0, le=1.0, description="share of messages")
    shift_s: float = Field(default=0.03, gt=0.0, le=100.0, description="how much earlier, s")

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        knobs.back_date_probability, knobs.back_date_s = self.probability, self.shift_s


class FrozenSensors(Fault):
    """Every measured value stays as it was; the stamps go on."""

    name: ClassVar[str] = "frozen_sensors"

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        knobs.is_frozen = True


_SIGNALS = {
    "position": "position_rad",
    "velocity": "velocity_rad_s",
    "load": "load_nm",
    "attitude": "world_from_body_wxyz",
    "body_position": "position_of_body_in_world_m",
    "body_velocity": "linear_vel_of_body_in_world_m_s",
    "body_angular_velocity": "angular_vel_of_body_in_world_rad_s",
    "imu": "imu_acceleration_m_s2",
}


class NanSensor(Fault):
    """One measured signal is NaN."""

    name: ClassVar[str] = "nan_sensor"
    signal: Literal[
        "position", "velocity", "load", "attitude", "body_position", "body_velocity", "body_angular_velocity", "imu"
    ] = Field(description=f"which: {', '.join(_SIGNALS)}")

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        knobs.nan_signals = (*knobs.nan_signals, _SIGNALS[self.signal])


class BadQuaternion(Fault):
    """The attitude's quaternion has not length 1."""

    name: ClassVar[str] = "bad_quaternion"
    scale: float = Field(default=0.0, ge=0.0, le=100.0, description="its length; 0 for all zeros")

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        knobs.quaternion_scale = self.scale


class ClockJump(Fault):
    """The robot's clock jumps; when the fault ends, it jumps back."""

    name: ClassVar[str] = "clock_jump"
    jump_s: float = Field(ge=-1e6, le=1e6, description="forward, or back if negative, s")

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        knobs.clock_offset_s += self.jump_s


class LowBattery(Fault):
    """The battery reports this state of charge."""

    name: ClassVar[str] = "low_battery"
    percent: float = Field(default=3.0, ge=0.0, le=100.0, description="state of charge, %")

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        knobs.battery_percent = self.percent


class BatteryFault(Fault):
    """The battery is faulty: a critical system fault, with which the motors do not power on."""

    name: ClassVar[str] = "battery_fault"

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        knobs.system_faults.append(
            SystemFault("battery_fault", onset_robot_stamp_ns, 1, "battery fault", "critical", ("power",))
        )


class MotorOverTemperature(Fault):
    """A motor reports a temperature; above the scenario's limit that is a critical system fault."""

    name: ClassVar[str] = "motor_over_temperature"
    joint: JointName = Field(default="fl_kn", description=f"which: {', '.join(JOINT_NAMES)}")
    temperature_c: float = Field(default=110.0, ge=-40.0, le=500.0, description="°C")

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        knobs.motor_temperature_c[self.joint] = self.temperature_c


class WeakMotor(Fault):
    """A motor gives only part of its torque."""

    name: ClassVar[str] = "weak_motor"
    joint: JointName = Field(default="fl_kn", description=f"which: {', '.join(JOINT_NAMES)}")
    gain: float = Field(default=0.0, ge=0.0, le=1.0, description="share of the torque; 0 for a dead motor")

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        knobs.motor_gain[JOINT_NAMES.index(self.joint)] *= self.gain


class SystemFaultRaised(Fault):
    """A system fault of your own wording."""

    name: ClassVar[str] = "system_fault"
    fault_name: str = Field(default="fake_fault", min_length=1, max_length=100, description="its name")
    message: str = Field(default="", max_length=1000, description="its message")
    severity: Literal["info", "warn", "critical"] = Field(default="warn", description="info, warn or critical")

    def turn(self, knobs: Knobs, onset_robot_stamp_ns: int) -> None:
        knobs.system_faults.append(
            SystemFault(self.fault_name, onset_robot_stamp_ns, 0, self.message, self.severity, ())
        )


class BehaviorFaultRaised(Fault):
    """A behaviour fault: joint control ends, the robot sinks to the ground. It stays until a client clears it."""

    name: ClassVar[str] = "behavior_fault"
    cause: Literal["fall", "hardware", "lease_timeout", "command_failure"] = Field(
        default="hardware", description="fall, hardware, lease_timeout or command_failure"
    )

    def start(self, victim: Victim) -> None:
        victim.fail_behavior(self.cause, "injected")


class PowerLoss(Fault):
    """The motors' power is cut at once."""

    name: ClassVar[str] = "power_loss"

    def start(self, victim: Victim) -> None:
        victim.lose_power("the motors lost power")


class Push(Fault):
    """Somebody pushes the body: its velocity changes at once."""

    name: ClassVar[str] = "push"
    forward_m_s: float = Field(default=0.0, ge=-10.0, le=10.0, description="along the world's x, m/s")
    left_m_s: float = Field(default=0.0, ge=-10.0, le=10.0, description="along the world's y, m/s")
    up_m_s: float = Field(default=0.0, ge=-10.0, le=10.0, description="m/s")
    roll_rad_s: float = Field(default=0.0, ge=-30.0, le=30.0, description="about the body's x, rad/s")
    pitch_rad_s: float = Field(default=0.0, ge=-30.0, le=30.0, description="about the body's y, rad/s")
    yaw_rad_s: float = Field(default=0.0, ge=-30.0, le=30.0, description="about the body's z, rad/s")

    def start(self, victim: Victim) -> None:
        victim.push(
            np.array([self.forward_m_s, self.left_m_s, self.up_m_s]),
            np.array([self.roll_rad_s, self.pitch_rad_s, self.yaw_rad_s]),
        )


FAULTS: dict[str, type[Fault]] = {
    fault.name: fault
    for fault in (
        StateGap,
        StateDelay,
        StateJitter,
        StateDrops,
        DuplicatedStates,
        BackDatedStates,
        CommandDelay,
        CommandJitter,
        CommandDrops,
        FrozenSensors,
        NanSensor,
        BadQuaternion,
        ClockJump,
        LowBattery,
        BatteryFault,
        MotorOverTemperature,
        WeakMotor,
        SystemFaultRaised,
        BehaviorFaultRaised,
        PowerLoss,
        Push,
    )
}


def make_fault(name: str, parameters: dict[str, Any]) -> Fault:
    """Build a fault from its name and parameters.

    Raises:
        BadInputError: The name or a parameter is unknown, or a value is not allowed; the message says which are.
    """
    if name not in FAULTS:
        raise BadInputError(f"fault {name!r} is unknown; allowed: {', '.join(FAULTS)}")
    try:
        return FAULTS[name].model_validate(parameters, strict=True)
    except ValidationError as error:
        raise BadInputError(f"fault {name}:\n{explain(error, FAULTS[name])}") from error
