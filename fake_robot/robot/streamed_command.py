"""One message of a joint-control stream: what must be in it, and what it says."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from bosdyn.api import robot_command_pb2

from fake_robot.body.drive import LOAD_LIMIT_NM
from fake_robot.network.status import StreamFailure
from spot_model.plant.command_channel import ServoCommand
from spot_model.robot import facts
from spot_model.robot.arm import ARM_HIGH_RAD, ARM_LOW_RAD
from spot_model.robot.facts import NS_PER_S, Array

INVALID_REQUEST: int = robot_command_pb2.JointControlStreamResponse.STATUS_INVALID_REQUEST
INACTIVE: int = robot_command_pb2.JointControlStreamResponse.STATUS_INACTIVE
EXPIRED: int = robot_command_pb2.JointControlStreamResponse.STATUS_EXPIRED
TOO_DISTANT: int = robot_command_pb2.JointControlStreamResponse.STATUS_TOO_DISTANT


class CommandRefusedError(Exception):
    """A command that ends its stream."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.failure = StreamFailure(status, message)


@dataclass(frozen=True)
class StreamedCommand:
    """Set-points as they came, checked; stamps are of the robot's clock."""

    key: int
    servo: ServoCommand
    """Set-points at the reference time, saturated; arrays of shape (1, 12)."""
    arm: ServoCommand | None
    """Likewise for an arm, arrays of shape (1, 7); None on a robot without one."""
    end_stamp_ns: int
    reference_stamp_ns: int | None
    """None until it is received, if the message names no reference time."""
    extrapolation_ns: int
    """The position follows the velocity set-point for so long after the reference time; 0 for never."""
    velocity_limit_rad_s: float | None

    def received_at(self, stamp_ns: int) -> StreamedCommand:
        """The command once the robot has it, which is the reference time unless the message names one."""
        if self.extrapolation_ns == 0 or self.reference_stamp_ns is not None:
            return self
        return replace(self, reference_stamp_ns=stamp_ns)

    def servo_at(self, stamp_ns: int) -> ServoCommand:
        """Set-points at an instant: the position extrapolated, and saturated at the joints' limits."""
        if self.extrapolation_ns == 0 or self.reference_stamp_ns is None:
            return self.servo
        ahead_ns = min(max(stamp_ns - self.reference_stamp_ns, 0), self.extrapolation_ns)
        servo = self.servo
        position = saturated_rad(servo.position_rad + servo.velocity_rad_s * (ahead_ns * 1e-9))
        return ServoCommand(position, servo.velocity_rad_s, servo.load_nm, servo.kp_nm_per_rad, servo.kd_nm_s_per_rad)


class StreamGrammar:
    """Reads the messages of one stream; remembers what holds from one to the next: the gains."""

    def __init__(self, n_joints: int = facts.N_JOINTS) -> None:
        self._n_joints = n_joints
        self._gains: tuple[Array, Array] | None = None
        self._sent_gains: tuple[list[float], list[float]] = ([], [])

    def read(self, request: Any) -> StreamedCommand:
        """Check one ``JointControlStreamRequest`` and take what it says.

        Raises:
            CommandRefusedError: It breaks a rule that holds whatever the robot is doing (INVALID_REQUEST).
        """
        if not request.HasField("joint_command"):
            raise _invalid("joint_command is missing; each message needs one")
        command = request.joint_command
        if not command.HasField("end_time"):
            raise _invalid("end_time is missing; give the robot time after which the command is void")
        values = [self._values(name, getattr(command, name)) for name in ("position", "velocity", "load")]
        values += self._read_gains(command)
        position, velocity, load, kp, kd = (of_joints[:, : facts.N_JOINTS] for of_joints in values)
        arm = [of_joints[:, facts.N_JOINTS :] for of_joints in values] if self._n_joints > facts.N_JOINTS else []
        if arm:
            arm[0] = np.clip(arm[0], ARM_LOW_RAD, ARM_HIGH_RAD)
        extrapolation_ns = _duration_ns(command.extrapolation_duration)
        if extrapolation_ns < 0:
            raise _invalid(f"extrapolation_duration = {extrapolation_ns * 1e-9:g} s; allowed: 0 and above")
        n_advice = len(request.contact_advice.contact_advice)
        if request.HasField("contact_advice") and n_advice not in (0, facts.N_LEGS):
            raise _invalid(f"contact_advice has {n_advice} values; allowed: none, or {facts.N_LEGS} (fl fr hl hr)")
        return StreamedCommand(
            key=command.user_command_key,
            servo=ServoCommand(saturated_rad(position), velocity, _saturated_nm(load), kp, kd),
            arm=ServoCommand(*arm) if arm else None,
            end_stamp_ns=_stamp_ns(command.end_time),
            reference_stamp_ns=_stamp_ns(command.reference_time) if command.HasField("reference_time") else None,
            extrapolation_ns=extrapolation_ns,
            velocity_limit_rad_s=_read_velocity_limit(command),
        )

    def _read_gains(self, command: Any) -> tuple[Array, Array]:
        sent = command.gains.k_q_p[:], command.gains.k_qd_p[:]
        # The same ones again, as in nearly every message, were checked before.
        if (sent[0] or sent[1]) and sent != self._sent_gains:
            if not (sent[0] and sent[1]):
                missing = "k_qd_p" if sent[0] else "k_q_p"
                raise _invalid(f"gains are given in part: {missing} is missing; give k_q_p and k_qd_p, or neither")
            gains = self._values("gains.k_q_p", sent[0]), self._values("gains.k_qd_p", sent[1])
            for name, values in zip(("k_q_p", "k_qd_p"), gains, strict=True):
                if values.min() < 0.0:
                    raise _invalid(f"gains.{name} holds {values.min():g}; allowed: 0 and above")
            self._gains, self._sent_gains = gains, sent
        if self._gains is None:
            raise _invalid("the first message has no gains; give k_q_p and k_qd_p there")
        return self._gains

    def _values(self, name: str, field: Any) -> Array:
        # By way of a list, which is several times as fast as the field itself.
        values = np.array(field[:], dtype=np.float64)
        if values.size != self._n_joints:
            arm = "an arm" if self._n_joints > facts.N_JOINTS else "no arm"
            raise _invalid(f"{name} has {values.size} values; allowed: {self._n_joints}, one a joint (with {arm})")
        # The sum is finite only if every value is, for what fits into a float32.
        if not math.isfinite(values.sum()):
            raise _invalid(f"{name} holds a value that is no finite number")
        return values[np.newaxis]


def saturated_rad(position_rad: Array) -> Array:
    """Position set-points saturated at the joints' limits."""
    return np.asarray(np.minimum(np.maximum(position_rad, facts.POSITION_LOW_RAD), facts.POSITION_HIGH_RAD))


def _saturated_nm(load_nm: Array) -> Array:
    return np.asarray(np.minimum(np.maximum(load_nm, -LOAD_LIMIT_NM), LOAD_LIMIT_NM))


def _read_velocity_limit(command: Any) -> float | None:
    """The limit of this one message: it has to come in each for which it shall hold, as the SDK says."""
    if not command.HasField("velocity_safety_limit"):
        return None
    limit = float(command.velocity_safety_limit.value)
    if not limit > 0.0:
        raise _invalid(f"velocity_safety_limit = {limit:g} rad/s; allowed: above 0")
    return limit


def _invalid(message: str) -> CommandRefusedError:
    return CommandRefusedError(INVALID_REQUEST, message)


def _stamp_ns(stamp: Any) -> int:
    return int(stamp.seconds) * NS_PER_S + int(stamp.nanos)


_duration_ns = _stamp_ns
