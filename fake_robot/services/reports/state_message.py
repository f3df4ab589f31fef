"""A snapshot of the robot as the ``RobotState`` message that clients poll."""

from __future__ import annotations

import numpy as np
from bosdyn.api import geometry_pb2, robot_state_pb2
from bosdyn.client.frame_helpers import HAND_FRAME_NAME, WR1_FRAME_NAME
from bosdyn.client.math_helpers import Quat, SE3Pose

from fake_robot.network.status import BehaviorFault, EstopLevel, Mode, Snapshot, SystemFault
from fake_robot.services.calls import duration_from_ns, timestamp_from_ns
from spot_model.robot.arm import (
    ARM_JOINT_NAMES,
    ARM_LINK_NAMES,
    ARM_LOW_RAD,
    HAND_FROM_WRIST_M,
    STOWED_HIGH_RAD,
    STOWED_LOW_RAD,
    arm_frames,
)
from spot_model.robot.facts import JOINT_NAMES, NS_PER_S, Array

ROOT_FRAME = "body"

_BEHAVIOR = {
    Mode.STANDING: robot_state_pb2.BehaviorState.STATE_STANDING,
    Mode.FROZEN: robot_state_pb2.BehaviorState.STATE_STANDING,
    Mode.STEPPING: robot_state_pb2.BehaviorState.STATE_STEPPING,
    Mode.WALKING: robot_state_pb2.BehaviorState.STATE_STEPPING,
    Mode.JOINT_CONTROL: robot_state_pb2.BehaviorState.STATE_STEPPING,
    Mode.STANDING_UP: robot_state_pb2.BehaviorState.STATE_TRANSITION,
    Mode.SITTING_DOWN: robot_state_pb2.BehaviorState.STATE_TRANSITION,
    Mode.RIGHTING: robot_state_pb2.BehaviorState.STATE_TRANSITION,
}


def fill_state(
    state: robot_state_pb2.RobotState, snapshot: Snapshot, *, is_wifi_on: bool, are_payload_ports_on: bool
) -> None:
    """Everything that ``GetRobotState`` tells; a robot without a manipulator state has no arm."""
    _fill_power(state.power_state, snapshot, is_wifi_on=is_wifi_on, are_payload_ports_on=are_payload_ports_on)
    if not snapshot.is_battery_missing:
        _fill_battery(state.battery_states.add(), snapshot)
    wifi = state.comms_states.add(timestamp=timestamp_from_ns(snapshot.robot_stamp_ns)).wifi_state
    wifi.current_mode, wifi.essid = robot_state_pb2.WiFiState.MODE_ACCESS_POINT, "fake-spot"
    _fill_estops(state, snapshot)
    _fill_faults(state, snapshot)
    fill_kinematics(state.kinematic_state, snapshot)
    _fill_feet(state, snapshot)
    if snapshot.arm.size:
        _fill_manipulator(state.manipulator_state, snapshot.arm[0])
    for name, temperature_c in snapshot.motor_temperature_c.items():
        state.system_state.motor_temperatures.add(name=_vendor_joint(name), temperature=temperature_c)
    state.terrain_state.is_unsafe_to_sit = False
    state.behavior_state.state = _BEHAVIOR.get(snapshot.mode, robot_state_pb2.BehaviorState.STATE_NOT_READY)


def behavior_fault_message(fault: BehaviorFault) -> robot_state_pb2.BehaviorFault:
    """A behaviour fault as clients see it."""
    status = (
        robot_state_pb2.BehaviorFault.STATUS_CLEARABLE
        if fault.is_clearable
        else robot_state_pb2.BehaviorFault.STATUS_UNCLEARABLE
    )
    return robot_state_pb2.BehaviorFault(
        behavior_fault_id=fault.fault_id,
        onset_timestamp=timestamp_from_ns(fault.onset_robot_stamp_ns),
        cause=robot_state_pb2.BehaviorFault.Cause.Value(f"CAUSE_{fault.cause.upper()}"),
        status=status,
    )


def system_fault_message(fault: SystemFault) -> robot_state_pb2.SystemFault:
    """A system fault as clients see it."""
    return robot_state_pb2.SystemFault(
        name=fault.name,
        onset_timestamp=timestamp_from_ns(fault.onset_robot_stamp_ns),
        code=fault.code,
        error_message=fault.message,
        attributes=fault.attributes,
        severity=_severity(fault),
    )


def _severity(fault: SystemFault) -> int:
    return int(robot_state_pb2.SystemFault.Severity.Value(f"SEVERITY_{fault.severity.upper()}"))


def _fill_power(
    power: robot_state_pb2.PowerState, snapshot: Snapshot, *, is_wifi_on: bool, are_payload_ports_on: bool
) -> None:
    power.timestamp.CopyFrom(timestamp_from_ns(snapshot.robot_stamp_ns))
    power.motor_power_state = power.MotorPowerState.Value(f"STATE_{snapshot.motor_power.name}")
    power.shore_power_state = power.SHORE_POWER_STATE_OFF
    power.robot_power_state = power.ROBOT_POWER_STATE_ON
    power.payload_ports_power_state = (
        power.PAYLOAD_PORTS_POWER_STATE_ON if are_payload_ports_on else power.PAYLOAD_PORTS_POWER_STATE_OFF
    )
    power.wifi_radio_power_state = power.WIFI_RADIO_POWER_STATE_ON if is_wifi_on else power.WIFI_RADIO_POWER_STATE_OFF
    if not snapshot.is_battery_missing:
        power.locomotion_charge_percentage.value = snapshot.battery_charge_percent
        power.locomotion_estimated_runtime.CopyFrom(duration_from_ns(round(snapshot.battery_runtime_s) * NS_PER_S))


def _fill_battery(battery: robot_state_pb2.BatteryState, snapshot: Snapshot) -> None:
    battery.timestamp.CopyFrom(timestamp_from_ns(snapshot.robot_stamp_ns))
    battery.identifier = "fake-battery"
    battery.charge_percentage.value = snapshot.battery_charge_percent
    battery.estimated_runtime.CopyFrom(duration_from_ns(round(snapshot.battery_runtime_s) * NS_PER_S))
    battery.current.value = snapshot.battery_current_a
    battery.voltage.value = snapshot.battery_voltage_v
    battery.temperatures.extend(snapshot.battery_temperature_c)
    battery.communications_loss_percent.value = 0.0
    battery.status = battery.STATUS_DISCHARGING


def _fill_manipulator(manipulator: robot_state_pb2.ManipulatorState, position_rad: Array) -> None:
    is_stowed = bool(((position_rad >= STOWED_LOW_RAD) & (position_rad <= STOWED_HIGH_RAD))[:-1].all())
    manipulator.stow_state = manipulator.STOWSTATE_STOWED if is_stowed else manipulator.STOWSTATE_DEPLOYED
    manipulator.gripper_open_percentage = 100.0 * max(0.0, float(position_rad[-1] / ARM_LOW_RAD[-1]))
    manipulator.carry_state = manipulator.CARRY_STATE_NOT_CARRIABLE


def _fill_estops(state: robot_state_pb2.RobotState, snapshot: Snapshot) -> None:
    stamp = timestamp_from_ns(snapshot.robot_stamp_ns)
    kinds = robot_state_pb2.EStopState
    is_software_stop = snapshot.estop_level is not EstopLevel.NONE
    state.estop_states.add(
        timestamp=stamp, name="hardware_estop", type=kinds.TYPE_HARDWARE, state=kinds.STATE_NOT_ESTOPPED
    )
    state.estop_states.add(
        timestamp=stamp,
        name="software_estop",
        type=kinds.TYPE_SOFTWARE,
        state=kinds.STATE_ESTOPPED if is_software_stop else kinds.STATE_NOT_ESTOPPED,
        state_description=snapshot.estop_level.value,
    )


def _fill_faults(state: robot_state_pb2.RobotState, snapshot: Snapshot) -> None:
    state.behavior_fault_state.faults.extend(map(behavior_fault_message, snapshot.behavior_faults))
    state.system_fault_state.faults.extend(map(system_fault_message, snapshot.system_faults))
    for fault in snapshot.system_faults:
        for attribute in fault.attributes:
            worst = max(state.system_fault_state.aggregated[attribute], _severity(fault))
            state.system_fault_state.aggregated[attribute] = worst


def fill_kinematics(kinematics: robot_state_pb2.KinematicState, snapshot: Snapshot) -> None:
    """Joints, velocities and frames of one instant."""
    kinematics.acquisition_timestamp.CopyFrom(timestamp_from_ns(snapshot.robot_stamp_ns))
    measured = np.array([snapshot.position_rad, snapshot.velocity_rad_s, snapshot.load_nm])
    names = (*JOINT_NAMES, *ARM_JOINT_NAMES) if snapshot.arm.size else JOINT_NAMES
    values = np.concatenate([measured, snapshot.arm], axis=1).T.tolist()
    for name, (position_rad, velocity_rad_s, load_nm) in zip(names, values, strict=True):
        joint = kinematics.joint_states.add(name=_vendor_joint(name))
        joint.position.value, joint.velocity.value, joint.load.value = position_rad, velocity_rad_s, load_nm
        joint.acceleration.value = 0.0
    _fill_velocity(
        kinematics.velocity_of_body_in_odom,
        snapshot.linear_vel_of_body_in_odom_m_s.tolist(),
        snapshot.angular_vel_of_body_in_odom_rad_s.tolist(),
    )
    _fill_velocity(
        kinematics.velocity_of_body_in_vision,
        snapshot.linear_vel_of_body_in_vision_m_s.tolist(),
        snapshot.angular_vel_of_body_in_vision_rad_s.tolist(),
    )
    kinematics.transforms_snapshot.CopyFrom(frame_tree(snapshot))


def _fill_velocity(velocity: geometry_pb2.SE3Velocity, linear: list[float], angular: list[float]) -> None:
    velocity.linear.x, velocity.linear.y, velocity.linear.z = linear
    velocity.angular.x, velocity.angular.y, velocity.angular.z = angular


def frame_tree(snapshot: Snapshot) -> geometry_pb2.FrameTreeSnapshot:
    """The tree of a real robot: the body is the root; odom, vision, flat_body and an arm's hand hang from it."""
    odom_from_body = _pose(snapshot.position_of_body_in_odom_m.tolist(), snapshot.odom_from_body_wxyz.tolist())
    vision_from_body = _pose(snapshot.position_of_body_in_vision_m.tolist(), snapshot.vision_from_body_wxyz.tolist())
    flat = SE3Pose(0.0, 0.0, 0.0, odom_from_body.rot.inverse() * Quat.from_yaw(odom_from_body.rot.to_yaw()))
    ground = SE3Pose(odom_from_body.x, odom_from_body.y, snapshot.ground_height_in_odom_m, Quat())
    edges = [
        ("odom", ROOT_FRAME, odom_from_body.inverse()),
        ("vision", ROOT_FRAME, vision_from_body.inverse()),
        ("flat_body", ROOT_FRAME, flat),
        ("gpe", "odom", ground),
        ("feet_center", ROOT_FRAME, SE3Pose(*snapshot.foot_position_in_body_m.mean(axis=0).tolist(), Quat())),
    ]
    if snapshot.arm.size:
        rotation, origin = arm_frames(snapshot.arm[0])[ARM_LINK_NAMES.index("link_wr1")]
        wrist = SE3Pose(*origin.tolist(), Quat.from_matrix(rotation))
        hand = wrist * SE3Pose(*HAND_FROM_WRIST_M, Quat())
        edges += [(WR1_FRAME_NAME, ROOT_FRAME, wrist), (HAND_FRAME_NAME, ROOT_FRAME, hand)]
    frames = geometry_pb2.FrameTreeSnapshot()
    frames.child_to_parent_edge_map[ROOT_FRAME].SetInParent()
    for name, parent, parent_from_child in edges:
        edge = frames.child_to_parent_edge_map[name]
        edge.parent_frame_name = parent
        edge.parent_tform_child.CopyFrom(parent_from_child.to_proto())
    return frames


def _fill_feet(state: robot_state_pb2.RobotState, snapshot: Snapshot) -> None:
    for (x_m, y_m, z_m), is_down in zip(
        snapshot.foot_position_in_body_m.tolist(), snapshot.foot_contact.tolist(), strict=True
    ):
        foot = state.foot_state.add()
        foot.foot_position_rt_body.x, foot.foot_position_rt_body.y, foot.foot_position_rt_body.z = x_m, y_m, z_m
        foot.contact = foot.CONTACT_MADE if is_down else foot.CONTACT_LOST
        foot.terrain.ground_mu_est = 0.8
        foot.terrain.frame_name = "odom"


def _pose(position_m: list[float], wxyz: list[float]) -> SE3Pose:
    return SE3Pose(*position_m, Quat(*wxyz))


def _vendor_joint(name: str) -> str:
    """``fl_hx`` as the polled state calls it: ``fl.hx``."""
    return name.replace("_", ".")
