"""The vendor's state message, byte for byte as a robot's, oddities included."""

from __future__ import annotations

from typing import Any

from bosdyn.api import header_pb2, robot_state_pb2

from fake_robot.body.sensing import IMU_PACKETS, IMU_PERIOD_NS, Frame, Report
from fake_robot.scenario.scenario import Scenario
from spot_model.robot.facts import NS_PER_S

RECEIVE_DELAY_NS = 900_000
"""The header's receive stamp is this much later than the joints' stamp, in a published recording."""
PACKET_RATE = 0.001
"""A period and not a rate, as the recording has it."""


class StateMessageBuilder:
    """Fills one message over and over: creating it anew each time costs several times as much.

    Its parts are kept at hand, because looking one up costs as much as filling it.
    """

    def __init__(self, scenario: Scenario, odom: Frame, vision: Frame) -> None:
        self._odom = odom
        self._imu_sign = -1.0 if scenario.sensors.has_negated_imu_quaternion else 1.0
        message = self._message = robot_state_pb2.RobotStateStreamResponse()
        # A real robot leaves the code unspecified; who demands OK waits for ever.
        message.header.error.code = header_pb2.CommonError.CODE_UNSPECIFIED
        inertial = message.inertial_state
        inertial.packet_rate = PACKET_RATE
        inertial.identifier = "body_imu"
        inertial.mounting_link_name = "body"
        site = inertial.position_imu_rt_link
        site.x, site.y, site.z = scenario.sensors.imu_from_body_m
        for _ in range(IMU_PACKETS):
            inertial.packets.add()
        joints, kinematics = message.joint_states, message.kinematic_state
        self._header_stamps = (message.header.request_received_timestamp, message.header.response_timestamp)
        self._stamps = (joints.acquisition_timestamp, kinematics.acquisition_timestamp)
        self._joints = (joints.position, joints.velocity, joints.load)
        self._packets = [
            (
                p.acceleration_rt_odom_in_link_frame,
                p.angular_velocity_rt_odom_in_link_frame,
                p.odom_rot_link,
                p.timestamp,
                age * IMU_PERIOD_NS,
            )
            for age, p in zip(reversed(range(IMU_PACKETS)), inertial.packets, strict=True)
        ]
        self._frames = [
            (frame, pose.position, pose.rotation, velocity.linear, velocity.angular)
            for frame, pose, velocity in (
                (odom, kinematics.odom_tform_body, kinematics.velocity_of_body_in_odom),
                (vision, kinematics.vision_tform_body, kinematics.velocity_of_body_in_vision),
            )
        ]
        self._contacts = message.contact_states
        self._last_command = message.last_command

    def build(self, report: Report, stamp_ns: int, last_key: int, last_stamp_ns: int) -> bytes:
        """The message on the wire; robot stamps are of the joints' acquisition and of the newest command's receipt.

        ``last_key`` is that command's key, 0 for none.
        """
        seconds, nanos = divmod(stamp_ns + RECEIVE_DELAY_NS, NS_PER_S)
        for stamp in self._header_stamps:
            stamp.seconds, stamp.nanos = seconds, nanos
        seconds, nanos = divmod(stamp_ns, NS_PER_S)
        for stamp in self._stamps:
            stamp.seconds, stamp.nanos = seconds, nanos
        position, velocity, load = self._joints
        arm = report.arm.tolist()
        position[:] = report.position_rad.tolist() + arm[0]
        velocity[:] = report.velocity_rad_s.tolist() + arm[1]
        load[:] = report.load_nm.tolist() + arm[2]
        self._fill_packets(report, stamp_ns)
        self._fill_kinematics(report)
        # CONTACT_MADE is 1, CONTACT_LOST 2.
        self._contacts[:] = [1 if made else 2 for made in report.foot_contact.tolist()]
        if last_key or self._last_command.user_command_key:
            self._last_command.user_command_key = last_key
            _set_stamp(self._last_command.received_timestamp, last_stamp_ns)
        wire: bytes = self._message.SerializeToString()
        return wire

    def _fill_packets(self, report: Report, stamp_ns: int) -> None:
        forces, turns = report.imu_acceleration_m_s2.tolist(), report.imu_angular_velocity_rad_s.tolist()
        attitudes = (self._imu_sign * report.imu_wxyz).tolist()
        for i, (force, turn, rotation, stamp, age_ns) in enumerate(self._packets):
            force.x, force.y, force.z = forces[i]
            turn.x, turn.y, turn.z = turns[i]
            rotation.w, rotation.x, rotation.y, rotation.z = self._odom.rotation(attitudes[i])
            _set_stamp(stamp, stamp_ns - age_ns)

    def _fill_kinematics(self, report: Report) -> None:
        position, attitude = report.position_of_body_in_world_m.tolist(), report.world_from_body_wxyz.tolist()
        linear_vel = report.linear_vel_of_body_in_world_m_s.tolist()
        angular_vel = report.angular_vel_of_body_in_world_rad_s.tolist()
        for frame, point, rotation, linear, angular in self._frames:
            point.x, point.y, point.z = frame.point(position)
            rotation.w, rotation.x, rotation.y, rotation.z = frame.rotation(attitude)
            linear.x, linear.y, linear.z = frame.vector(linear_vel)
            angular.x, angular.y, angular.z = frame.vector(angular_vel)


def _set_stamp(stamp: Any, stamp_ns: int) -> None:
    stamp.seconds, stamp.nanos = divmod(stamp_ns, NS_PER_S)
