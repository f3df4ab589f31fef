"""Turn a state message of the vendor's stream into a :class:`RobotState`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from bosdyn.api import robot_state_pb2
from google.protobuf.message import DecodeError

from spot_model.errors import BadInputError
from spot_model.robot.facts import N_JOINTS, N_LEGS
from spot_model.robot.stamps import NS_PER_S
from spot_model.robot.state import Array, ImuPacket, RobotState

_CONTACT_MADE: Final = robot_state_pb2.FootState.CONTACT_MADE
N_JOINTS_WITH_ARM: Final = 19


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


def robot_state_from_wire(wire: bytes, host_stamp_ns: int | Callable[[int], int]) -> RobotState:
    """Decode the wire bytes of a RobotStateStreamResponse.

    Args:
        wire: The message as it came from the network.
        host_stamp_ns: When it was received, host clock; or what tells this from the state's own stamp.

    Raises:
        StateMessageError: The bytes are no such message, or arrays have other lengths than Spot's.
    """
    message = robot_state_pb2.RobotStateStreamResponse()
    try:
        message.ParseFromString(wire)
    except DecodeError as error:
        raise StateMessageError(f"state message of {len(wire)} bytes cannot be parsed: {error}") from error
    return robot_state_from_message(message, host_stamp_ns)


def robot_state_from_message(
    message: robot_state_pb2.RobotStateStreamResponse,
    host_stamp_ns: int | Callable[[int], int],
) -> RobotState:
    """Convert a RobotStateStreamResponse; the seven arm joints, where there are any, are left out.

    The state's stamp is the joints' acquisition stamp. No value is checked here, so NaN passes through. A robot that
    reports no contacts touches the ground with no foot.

    Raises:
        StateMessageError: Arrays have other lengths than Spot's.
    """
    joints, kinematics, last = message.joint_states, message.kinematic_state, message.last_command
    odom_from_body, velocity = kinematics.odom_tform_body, kinematics.velocity_of_body_in_odom
    contacts = message.contact_states
    if len(contacts) not in (0, N_LEGS):
        raise StateMessageError(f"state message has {len(contacts)} contact states; Spot sends {N_LEGS}, or none")
    robot_stamp_ns = _stamp_ns(joints.acquisition_timestamp)
    return RobotState(
        robot_stamp_ns=robot_stamp_ns,
        host_stamp_ns=host_stamp_ns if isinstance(host_stamp_ns, int) else host_stamp_ns(robot_stamp_ns),
        position_rad=_base_joints(joints.position, "position"),
        velocity_rad_s=_base_joints(joints.velocity, "velocity"),
        load_nm=_base_joints(joints.load, "load"),
        position_of_body_in_odom_m=_vector(odom_from_body.position),
        odom_from_body_wxyz=_quaternion_wxyz(odom_from_body.rotation),
        linear_vel_of_body_in_odom_m_s=_vector(velocity.linear),
        angular_vel_of_body_in_odom_rad_s=_vector(velocity.angular),
        foot_contact=np.array(contacts[:]) == _CONTACT_MADE if contacts else np.zeros(N_LEGS, dtype=np.bool_),
        last_command_key=last.user_command_key,
        last_command_robot_stamp_ns=_stamp_ns(last.received_timestamp),
        imu=_ImuPackets(message.inertial_state.packets),
    )


def _imu_packet(packet: robot_state_pb2.ImuState.Packet) -> ImuPacket:
    return ImuPacket(
        robot_stamp_ns=_stamp_ns(packet.timestamp),
        acceleration_of_imu_in_link_m_s2=_vector(packet.acceleration_rt_odom_in_link_frame),
        angular_vel_of_link_in_link_rad_s=_vector(packet.angular_velocity_rt_odom_in_link_frame),
        odom_from_link_wxyz=_quaternion_wxyz(packet.odom_rot_link),
    )


def _base_joints(values: Sequence[float], name: str) -> Array:
    # By way of a list, which is several times as fast as the field itself.
    array = np.array(values[:], dtype=np.float64)
    if array.size not in (N_JOINTS, N_JOINTS_WITH_ARM):
        raise StateMessageError(
            f"state message has {array.size} joint {name} values; "
            f"Spot sends {N_JOINTS}, or {N_JOINTS_WITH_ARM} with an arm"
        )
    return array[:N_JOINTS]


def _stamp_ns(timestamp: object) -> int:
    return int(timestamp.seconds) * NS_PER_S + int(timestamp.nanos)  # type: ignore[attr-defined]


def _vector(vector: object) -> Array:
    return np.array([vector.x, vector.y, vector.z])  # type: ignore[attr-defined]


def _quaternion_wxyz(quaternion: object) -> Array:
    q = quaternion
    return np.array([q.w, q.x, q.y, q.z])  # type: ignore[attr-defined]
