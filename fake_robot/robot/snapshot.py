"""The robot at one instant: as it reports itself, and as it is."""

from __future__ import annotations

import numpy as np

from fake_robot.body.clock import RobotClock
from fake_robot.body.truth import Truth
from fake_robot.network.status import Snapshot
from fake_robot.robot.simulation import Simulation
from spot_model.robot.leg_kinematics import foot_position_in_body_m


def snapshot_of(simulation: Simulation, clock: RobotClock) -> Snapshot:
    """The newest report in the shape that the services want."""
    report, modes, energy = simulation.report, simulation.modes, simulation.energy
    effects, odom, vision = simulation.faults.effects, simulation.odom, simulation.vision
    position = report.position_of_body_in_world_m.tolist()
    attitude = report.world_from_body_wxyz.tolist()
    linear = report.linear_vel_of_body_in_world_m_s.tolist()
    angular = report.angular_vel_of_body_in_world_rad_s.tolist()
    ground = (*position[:2], position[2] - simulation.body.height_m())
    return Snapshot(
        robot_stamp_ns=clock.stamp_ns(report.elapsed_ns),
        mode=modes.mode,
        motor_power=modes.motor_power,
        estop_level=modes.estop_level,
        position_rad=report.position_rad,
        velocity_rad_s=report.velocity_rad_s,
        load_nm=report.load_nm,
        arm=report.arm,
        position_of_body_in_odom_m=np.array(odom.point(position)),
        odom_from_body_wxyz=np.array(odom.rotation(attitude)),
        position_of_body_in_vision_m=np.array(vision.point(position)),
        vision_from_body_wxyz=np.array(vision.rotation(attitude)),
        linear_vel_of_body_in_odom_m_s=np.array(odom.vector(linear)),
        angular_vel_of_body_in_odom_rad_s=np.array(odom.vector(angular)),
        linear_vel_of_body_in_vision_m_s=np.array(vision.vector(linear)),
        angular_vel_of_body_in_vision_rad_s=np.array(vision.vector(angular)),
        foot_contact=report.foot_contact,
        foot_position_in_body_m=foot_position_in_body_m(report.position_rad),
        ground_height_in_odom_m=odom.point(ground)[2],
        battery_charge_percent=energy.shown_percent(effects),
        battery_voltage_v=energy.voltage_v,
        battery_current_a=-energy.current_a,
        battery_temperature_c=tuple(simulation.scenario.battery.temperature_c + d for d in (0.0, 0.4, -0.3, 0.1)),
        battery_runtime_s=energy.runtime_s(),
        is_battery_missing=effects.battery_missing,
        motor_temperature_c=energy.shown_temperatures_c(effects),
        behavior_faults=tuple(modes.behavior_faults),
        system_faults=simulation.system_faults(),
        distance_m=simulation.distance_m,
        time_moving_s=simulation.time_moving_s,
        time_powered_s=simulation.time_powered_s,
        joint_commands_received=simulation.joint_control.received,
        is_joint_control_failed=simulation.joint_control.is_failed,
        walk_progress=simulation.walker.progress,
        stance_progress=modes.stance_progress,
        stand_height_m=simulation.scenario.motion.stand_height_m,
    )


def truth_of(simulation: Simulation, clock: RobotClock) -> Truth:
    """The body as it is."""
    body, extremes = simulation.body, simulation.extremes
    height_m = body.height_m()
    return Truth(
        robot_stamp_ns=clock.stamp_ns(simulation.now_ns),
        position_of_body_in_world_m=body.base_position_m.copy(),
        world_from_body_wxyz=body.base_wxyz.copy(),
        linear_vel_of_body_in_world_m_s=body.base_velocity[:3].copy(),
        angular_vel_of_body_in_body_rad_s=body.base_velocity[3:].copy(),
        body_height_m=height_m,
        joint_position_rad=body.joint_position_rad.copy(),
        joint_velocity_rad_s=body.joint_velocity_rad_s.copy(),
        joint_torque_nm=body.motor_torque_nm.copy(),
        foot_contact=body.foot_force_n > 0.0,
        foot_force_n=body.foot_force_n,
        has_fallen=body.tilt_rad() > 1.05 or any(fault.cause == "fall" for fault in simulation.modes.behavior_faults),
        body_height_min_m=min(extremes.height_min_m, height_m),
        peak_torque_nm=extremes.peak_torque_nm,
    )
