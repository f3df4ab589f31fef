"""The vendor's state message, byte for byte as a robot's, oddities included."""

from __future__ import annotations

from typing import Any

from bosdyn.api import header_pb2, robot_state_pb2

from fake_robot.frames import Frame, Quaternion, Vector
from fake_robot.scenario import Scenario
from fake_robot.sensing import IMU_PACKETS, IMU_PERIOD_NS, Report
from spot_model.facts import Array

NS_PER_S = 1_000_000_000
RECEIVE_DELAY_NS = 900_000
"""The header's receive stamp is this much later than the joints' stamp, in a published recording."""
PACKET_RATE = 0.001
"""A period and not a rate, as the recording has it."""


class StateMessageBuilder:
    """Fills one message over and over: creating it anew each time costs several times as much."""

    def __init__(self, scenario: Scenario, odom: Frame, vision: Frame) -> None:
        self._odom, self._vision = odom, vision
        self._imu_sign = -1.0 if scenario.sensors.has_negated_imu_quaternion else 1.0
        message = self._message = robot_state_pb2.RobotStateStreamResponse()
        # A real robot leaves the code unspecified; who demands OK waits for ever.
        message.header.error.code = header_pb2.CommonError.CODE_UNSPECIFIED
        inertial = message.inertial_state
        inertial.packet_rate = PACKET_RATE
        inertial.identifier = "body_imu"
        inertial.mounting_link_name = "body"
        _set_vector(inertial.position_imu_rt_link, scenario.sensors.imu_from_body_m)
        for _ in range(IMU_PACKETS):
            inertial.packets.add()
        self._joints = message.joint_states
        self._packets = list(inertial.packets)
        self._kinematics = message.kinematic_state

    def build(self, report: Report, stamp_ns: int, last_key: int, last_stamp_ns: int) -> bytes:
        """The message on the wire.

        Args:
            report: What the robot reports.
            stamp_ns: Robot stamp of the joints' acquisition.
            last_key: Key of the newest command that the robot has received; 0 for none.
            last_stamp_ns: Robot stamp at which it received it.
        """
        message, joints, kinematics = self._message, self._joints, self._kinematics
        _set_stamp(message.header.request_received_timestamp, stamp_ns + RECEIVE_DELAY_NS)
        _set_stamp(message.header.response_timestamp, stamp_ns + RECEIVE_DELAY_NS)
        _set_stamp(joints.acquisition_timestamp, stamp_ns)
        _set_values(joints.position, report.position_rad)
        _set_values(joints.velocity, report.velocity_rad_s)
        _set_values(joints.load, report.load_nm)
        self._fill_packets(report, stamp_ns)
        _set_stamp(kinematics.acquisition_timestamp, stamp_ns)
        position, attitude = report.position_of_body_in_world_m.tolist(), report.world_from_body_wxyz.tolist()
        linear = report.linear_vel_of_body_in_world_m_s.tolist()
        angular = report.angular_vel_of_body_in_world_rad_s.tolist()
        for frame, pose, velocity in (
            (self._odom, kinematics.odom_tform_body, kinematics.velocity_of_body_in_odom),
            (self._vision, kinematics.vision_tform_body, kinematics.velocity_of_body_in_vision),
        ):
            _set_vector(pose.position, frame.point(position))
            _set_quaternion(pose.rotation, frame.rotation(attitude))
            _set_vector(velocity.linear, frame.vector(linear))
            _set_vector(velocity.angular, frame.vector(angular))
        del message.contact_states[:]
        # CONTACT_MADE is 1, CONTACT_LOST 2.
        message.contact_states.extend([1 if made else 2 for made in report.foot_contact.tolist()])
        if last_key:
            message.last_command.user_command_key = last_key
            _set_stamp(message.last_command.received_timestamp, last_stamp_ns)
        wire: bytes = message.SerializeToString()
        return wire

    def _fill_packets(self, report: Report, stamp_ns: int) -> None:
        forces, turns = report.imu_acceleration_m_s2.tolist(), report.imu_angular_velocity_rad_s.tolist()
        attitudes = (self._imu_sign * report.imu_wxyz).tolist()
        for i, packet in enumerate(self._packets):
            force, turn = packet.acceleration_rt_odom_in_link_frame, packet.angular_velocity_rt_odom_in_link_frame
            force.x, force.y, force.z = forces[i]
            turn.x, turn.y, turn.z = turns[i]
            _set_quaternion(packet.odom_rot_link, self._odom.rotation(attitudes[i]))
            _set_stamp(packet.timestamp, stamp_ns - (IMU_PACKETS - 1 - i) * IMU_PERIOD_NS)


def _set_stamp(stamp: Any, stamp_ns: int) -> None:
    stamp.seconds, stamp.nanos = divmod(stamp_ns, NS_PER_S)


def _set_values(field: Any, values: Array) -> None:
    del field[:]
    field.extend(values.tolist())


def _set_vector(vector: Any, values: Vector) -> None:
    vector.x, vector.y, vector.z = values


def _set_quaternion(quaternion: Any, wxyz: Quaternion) -> None:
    quaternion.w, quaternion.x, quaternion.y, quaternion.z = wxyz
