"""Decode a state message of the vendor's stream, into a :class:`RobotState` for the loop or a record for the log."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

import numpy as np
from bosdyn.api import geometry_pb2, robot_state_pb2
from google.protobuf.message import DecodeError
from google.protobuf.timestamp_pb2 import Timestamp

from spot_model.errors import BadInputError
from spot_model.robot.arm import N_ARM_JOINTS
from spot_model.robot.facts import N_JOINTS, N_LEGS, NS_PER_S
from spot_model.robot.state import ImuPacket, RobotState
from spot_protos import log_pb2

N_JOINTS_WITH_ARM: Final = N_JOINTS + N_ARM_JOINTS
_CONTACT_MADE: Final = robot_state_pb2.FootState.CONTACT_MADE
_ARRAYS: Final = (
    "position_rad",
    "velocity_rad_s",
    "load_nm",
    "position_of_body_in_odom_m",
    "odom_from_body_wxyz",
    "linear_vel_of_body_in_odom_m_s",
    "angular_vel_of_body_in_odom_rad_s",
)


class StateMessageError(BadInputError):
    """A state message is not one of Spot's; the text says what is wrong with it."""


class _ImuPackets(Sequence[ImuPacket]):
    """Decoded each time they are asked for: it takes as long as all the rest of a state, and no command needs it."""

    def __init__(self, packets: Sequence[robot_state_pb2.ImuState.Packet]) -> None:
        self._packets = packets

    def __len__(self) -> int:
        return len(self._packets)

    def __getitem__(self, place: Any) -> Any:
        return _imu_packet(self._packets[place])

    def __iter__(self) -> Iterator[ImuPacket]:
        return map(_imu_packet, self._packets)


def robot_state_from_wire(wire: bytes, host_stamp_ns: int | Callable[[int], int]) -> RobotState:
    """Decode the wire bytes of a RobotStateStreamResponse, as it came from the network.

    The state's stamp is the joints' acquisition stamp. An arm's joints, where there are any, stand apart. No value
    is checked here, so NaN passes through. A robot that reports no contacts touches the ground with no foot.
    ``host_stamp_ns`` is when it was received, host clock; or what tells this from the state's own stamp.

    Raises:
        StateMessageError: The bytes are no such message, or arrays have other lengths than Spot's.
    """
    message = robot_state_pb2.RobotStateStreamResponse()
    try:
        message.ParseFromString(wire)
    except DecodeError as error:
        raise StateMessageError(f"state message of {len(wire)} bytes cannot be parsed: {error}") from error
    joints, n_contacts = message.joint_states, len(message.contact_states)
    for name, n in (("position", len(joints.position)), ("velocity", len(joints.velocity)), ("load", len(joints.load))):
        if n not in (N_JOINTS, N_JOINTS_WITH_ARM):
            raise _wrong_length(name, n)
    if not len(joints.position) == len(joints.velocity) == len(joints.load):
        raise StateMessageError("state message has positions, velocities and loads of unequal numbers of joints")
    if n_contacts not in (0, N_LEGS):
        raise StateMessageError(f"state message has {n_contacts} contact states; Spot sends {N_LEGS}, or none")
    values = _values(message)
    for name in _ARRAYS:
        values[name] = np.array(values[name], dtype=np.float64)
    values["foot_contact"] = np.array(values["foot_contact"] or [False] * N_LEGS, dtype=np.bool_)
    received_ns = host_stamp_ns if isinstance(host_stamp_ns, int) else host_stamp_ns(values["robot_stamp_ns"])
    return RobotState(
        host_stamp_ns=received_ns,
        imu=_ImuPackets(message.inertial_state.packets),
        arm_position_rad=joints.position[N_JOINTS:],
        arm_load_nm=joints.load[N_JOINTS:],
        **values,
    )


def state_record_from_wire(wire: bytes, host_stamp_ns: int) -> log_pb2.State:
    """Decode the same bytes into the log's record, without arrays, which would cost three times as much.

    What is missing in the message is missing in the record. An arm's joints go with it to the writer.

    Raises:
        google.protobuf.message.DecodeError: The bytes are no such message.
        StateMessageError: It has another number of joints than Spot.
    """
    message = robot_state_pb2.RobotStateStreamResponse.FromString(wire)
    n_joints = len(message.joint_states.position)
    if n_joints not in (0, N_JOINTS, N_JOINTS_WITH_ARM):
        raise _wrong_length("position", n_joints)
    try:
        imu = [log_pb2.ImuPacket(**_packet_values(packet)) for packet in message.inertial_state.packets]
        record = log_pb2.State(host_stamp_ns=host_stamp_ns, imu=imu, **_values(message))
    except ValueError as error:  # a stamp that no clock shows
        raise StateMessageError(f"state message cannot be kept: {error}") from error
    if n_joints == N_JOINTS_WITH_ARM:
        joints, arm = message.joint_states, record.arm
        arm.robot_stamp_ns, arm.host_stamp_ns = record.robot_stamp_ns, host_stamp_ns
        arm.position_rad[:] = joints.position[N_JOINTS:]
        arm.velocity_rad_s[:] = joints.velocity[N_JOINTS:]
        arm.load_nm[:] = joints.load[N_JOINTS:]
    return record


def _wrong_length(name: str, n: int) -> StateMessageError:
    return StateMessageError(
        f"state message has {n} joint {name} values; Spot sends {N_JOINTS}, or {N_JOINTS_WITH_ARM} with an arm"
    )


def _values(message: robot_state_pb2.RobotStateStreamResponse) -> dict[str, Any]:
    """The fields that a :class:`RobotState` and a record share, as plain numbers and lists."""
    joints, kinematics, last = message.joint_states, message.kinematic_state, message.last_command
    pose, velocity = kinematics.odom_tform_body, kinematics.velocity_of_body_in_odom
    return {
        "robot_stamp_ns": _stamp_ns(joints.acquisition_timestamp),
        # A slice is a list, which becomes an array several times as fast as the field itself.
        "position_rad": joints.position[:N_JOINTS],
        "velocity_rad_s": joints.velocity[:N_JOINTS],
        "load_nm": joints.load[:N_JOINTS],
        "position_of_body_in_odom_m": _vector(pose.position),
        "odom_from_body_wxyz": _quaternion_wxyz(pose.rotation),
        "linear_vel_of_body_in_odom_m_s": _vector(velocity.linear),
        "angular_vel_of_body_in_odom_rad_s": _vector(velocity.angular),
        "foot_contact": [contact == _CONTACT_MADE for contact in message.contact_states],
        "last_command_key": last.user_command_key,
        "last_command_robot_stamp_ns": _stamp_ns(last.received_timestamp),
    }


def _packet_values(packet: robot_state_pb2.ImuState.Packet) -> dict[str, Any]:
    return {
        "robot_stamp_ns": _stamp_ns(packet.timestamp),
        "acceleration_of_imu_in_link_m_s2": _vector(packet.acceleration_rt_odom_in_link_frame),
        "angular_vel_of_link_in_link_rad_s": _vector(packet.angular_velocity_rt_odom_in_link_frame),
        "odom_from_link_wxyz": _quaternion_wxyz(packet.odom_rot_link),
    }


def _imu_packet(packet: robot_state_pb2.ImuState.Packet) -> ImuPacket:
    stamp_ns, force, turn_rate, rotation = _packet_values(packet).values()
    numbers = np.array((*force, *turn_rate, *rotation))  # one array takes less time than three
    return ImuPacket(stamp_ns, numbers[:3], numbers[3:6], numbers[6:])


def _stamp_ns(timestamp: Timestamp) -> int:
    return timestamp.seconds * NS_PER_S + timestamp.nanos


def _vector(vector: geometry_pb2.Vec3) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def _quaternion_wxyz(quaternion: geometry_pb2.Quaternion) -> tuple[float, float, float, float]:
    return quaternion.w, quaternion.x, quaternion.y, quaternion.z
