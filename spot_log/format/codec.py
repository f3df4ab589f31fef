"""Turn records into the log's protobuf messages; the reader does the way back, whole topics at a time."""

from __future__ import annotations

from collections.abc import Mapping

from spot_log.format.records import EventRecord, RunHeader
from spot_model.robot.state import RobotState, SlowState
from spot_protos import log_pb2


def header_to_proto(header: RunHeader) -> log_pb2.Header:
    """Convert a run's header, field by field."""
    return log_pb2.Header(
        schema=header.schema,
        run_id=header.run_id,
        started_host_stamp_ns=header.started_host_stamp_ns,
        robot_id=header.robot_id,
        adapter=header.adapter,
        policy_name=header.policy_name,
        policy_sha256=header.policy_sha256,
        policy_contract_json=header.policy_contract_json,
        config_json=header.config_json,
        command_sequence=header.command_sequence,
        repeat=header.repeat,
        labels=dict(header.labels),
        software_version=header.software_version,
        software_revision=header.software_revision,
        joint_names=header.joint_names,
        foot_names=header.foot_names,
    )


def header_from_proto(message: log_pb2.Header) -> RunHeader:
    """Convert a header back."""
    return RunHeader(
        schema=message.schema,
        run_id=message.run_id,
        started_host_stamp_ns=message.started_host_stamp_ns,
        robot_id=message.robot_id,
        adapter=message.adapter,
        policy_name=message.policy_name,
        policy_sha256=message.policy_sha256,
        policy_contract_json=message.policy_contract_json,
        config_json=message.config_json,
        command_sequence=message.command_sequence,
        repeat=message.repeat,
        labels=dict(sorted(message.labels.items())),
        software_version=message.software_version,
        software_revision=message.software_revision,
        joint_names=tuple(message.joint_names),
        foot_names=tuple(message.foot_names),
    )


def state_to_proto(state: RobotState) -> log_pb2.State:
    """Convert a state."""
    return log_pb2.State(
        robot_stamp_ns=state.robot_stamp_ns,
        host_stamp_ns=state.host_stamp_ns,
        position_rad=state.position_rad.tolist(),
        velocity_rad_s=state.velocity_rad_s.tolist(),
        load_nm=state.load_nm.tolist(),
        position_of_body_in_odom_m=state.position_of_body_in_odom_m.tolist(),
        odom_from_body_wxyz=state.odom_from_body_wxyz.tolist(),
        linear_vel_of_body_in_odom_m_s=state.linear_vel_of_body_in_odom_m_s.tolist(),
        angular_vel_of_body_in_odom_rad_s=state.angular_vel_of_body_in_odom_rad_s.tolist(),
        foot_contact=state.foot_contact.tolist(),
        last_command_key=state.last_command_key,
        last_command_robot_stamp_ns=state.last_command_robot_stamp_ns,
        imu=[
            log_pb2.ImuPacket(
                robot_stamp_ns=packet.robot_stamp_ns,
                acceleration_of_imu_in_link_m_s2=packet.acceleration_of_imu_in_link_m_s2.tolist(),
                angular_vel_of_link_in_link_rad_s=packet.angular_vel_of_link_in_link_rad_s.tolist(),
                odom_from_link_wxyz=packet.odom_from_link_wxyz.tolist(),
            )
            for packet in state.imu
        ],
    )


def slow_state_to_proto(state: SlowState) -> log_pb2.SlowState:
    """Convert a slow state."""
    return log_pb2.SlowState(
        robot_stamp_ns=state.robot_stamp_ns,
        host_stamp_ns=state.host_stamp_ns,
        motors_powered=state.motors_powered,
        estopped=state.estopped,
        battery_charge_percent=state.battery_charge_percent,
        battery_voltage_v=state.battery_voltage_v,
        battery_current_a=state.battery_current_a,
        battery_temperature_c=state.battery_temperature_c,
        motor_temperature_c=dict(state.motor_temperature_c),
        system_faults=state.system_faults,
        behavior_faults=state.behavior_faults,
        service_faults=state.service_faults,
    )


def event_to_proto(record: EventRecord) -> log_pb2.Event:
    """Convert an event."""
    return log_pb2.Event(
        host_stamp_ns=record.host_stamp_ns,
        robot_stamp_ns=record.robot_stamp_ns,
        severity=log_pb2.Event.Severity.Name(int(record.severity)),
        name=record.name,
        text=record.text,
        values={key: float(value) for key, value in record.values.items()},
    )


def footer_to_proto(
    host_stamp_ns: int, messages: Mapping[str, int], dropped: Mapping[str, int], outcome: str
) -> log_pb2.Footer:
    """Build the footer: what was written, what was lost, how the run ended."""
    return log_pb2.Footer(host_stamp_ns=host_stamp_ns, messages=dict(messages), dropped=dict(dropped), outcome=outcome)
