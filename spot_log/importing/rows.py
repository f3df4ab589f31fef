"""A recording's rows as the log's records: a state a row, and a command, tick or poll where they are mapped."""

from __future__ import annotations

import math

import numpy as np

from spot_log.importing.signals import Recording
from spot_model.errors import BadInputError
from spot_model.robot.rotation import rotate_wxyz
from spot_model.robot.state import Array
from spot_protos import log_pb2

_STATE_SIGNALS = {
    "position": "position_rad",
    "velocity": "velocity_rad_s",
    "load": "load_nm",
    "position_of_body_in_odom": "position_of_body_in_odom_m",
    "odom_from_body": "odom_from_body_wxyz",
}
_COMMAND_SIGNALS = {
    "setpoint_position": "position_rad",
    "setpoint_velocity": "velocity_rad_s",
    "feedforward": "load_nm",
    "kp": "kp_nm_per_rad",
    "kd": "kd_nm_s_per_rad",
}
_TICK_SIGNALS = ("velocity_command", "action", "observation")
_SLOW_SIGNALS = ("battery_voltage", "battery_current", "battery_charge", "motor_temperature")
SLOW_PERIOD_NS = 100_000_000
Record = log_pb2.State | log_pb2.Command | log_pb2.Tick | log_pb2.SlowState


def records_of(recording: Recording) -> list[Record]:
    """What the log will hold, oldest first. Raises BadInputError, OSError."""
    records = _states(recording) + _commands(recording) + _ticks(recording) + _slow_states(recording)
    return sorted(records, key=lambda record: record.host_stamp_ns)


def _states(recording: Recording) -> list[Record]:
    columns = {field: recording.signal(name) for name, field in _STATE_SIGNALS.items() if recording.has(name)}
    for name, unit in (("linear_vel_of_body", "m_s"), ("angular_vel_of_body", "rad_s")):
        velocity = _in_odom(recording, name, columns.get("odom_from_body_wxyz"))
        if velocity is not None:
            columns[f"{name}_in_odom_{unit}"] = velocity
    rows = {field: values.tolist() for field, values in columns.items()}
    contact = recording.signal("foot_contact") > 0.5 if recording.has("foot_contact") else None
    if contact is not None and contact.shape[1] != len(recording.mapping.foot_names):
        names = ", ".join(recording.mapping.foot_names)
        raise BadInputError(f"signal foot_contact has {contact.shape[1]} columns; foot_names are {names}")
    feet = [] if contact is None else contact.tolist()
    imu = _imu(recording)
    records: list[Record] = []
    for i, stamp_ns in enumerate(recording.stamps_ns.tolist()):
        fields = {field: values[i] for field, values in rows.items()}
        state = log_pb2.State(robot_stamp_ns=stamp_ns, host_stamp_ns=stamp_ns, **fields)
        state.foot_contact.extend(feet[i] if feet else [])
        if imu:
            state.imu.append(imu[i])
        records.append(state)
    return records


def _imu(recording: Recording) -> list[log_pb2.ImuPacket]:
    fields = {
        "acceleration_of_imu_in_link": "acceleration_of_imu_in_link_m_s2",
        "angular_vel_of_link_in_link": "angular_vel_of_link_in_link_rad_s",
    }
    rows = {field: recording.signal(name).tolist() for name, field in fields.items() if recording.has(name)}
    if not rows:
        return []
    return [
        log_pb2.ImuPacket(robot_stamp_ns=stamp_ns, **{field: values[i] for field, values in rows.items()})
        for i, stamp_ns in enumerate(recording.stamps_ns.tolist())
    ]


def _in_odom(recording: Recording, name: str, odom_from_body_wxyz: Array | None) -> Array | None:
    if recording.has(f"{name}_in_odom"):
        return recording.signal(f"{name}_in_odom")
    if not recording.has(f"{name}_in_body"):
        return None
    if odom_from_body_wxyz is None:
        raise BadInputError(f"signal {name}_in_body needs the signal odom_from_body, which tells how the body lies")
    rotated: Array = rotate_wxyz(odom_from_body_wxyz, recording.signal(f"{name}_in_body"))
    return rotated


def _commands(recording: Recording) -> list[Record]:
    if not any(recording.has(name) for name in ("setpoint_position", "setpoint_velocity", "feedforward")):
        return []
    columns = {field: recording.signal(name) for name, field in _COMMAND_SIGNALS.items() if recording.has(name)}
    rows = {field: values.tolist() for field, values in columns.items()}
    return [
        log_pb2.Command(
            key=i + 1,
            host_stamp_ns=stamp_ns,
            robot_stamp_ns=stamp_ns,
            **{field: values[i] for field, values in rows.items()},
        )
        for i, stamp_ns in enumerate(recording.stamps_ns.tolist())
    ]


def _ticks(recording: Recording) -> list[Record]:
    rows = {name: recording.signal(name).tolist() for name in _TICK_SIGNALS if recording.has(name)}
    if not rows:
        return []
    return [
        log_pb2.Tick(
            index=i,
            robot_stamp_ns=stamp_ns,
            host_stamp_ns=stamp_ns,
            mode="imported",
            state_age_s=math.nan,
            inference_s=math.nan,
            compute_s=math.nan,
            **{name: values[i] for name, values in rows.items()},
        )
        for i, stamp_ns in enumerate(recording.stamps_ns.tolist())
    ]


def _slow_states(recording: Recording) -> list[Record]:
    """A poll every 0.1 s at most: these signals are slow, whatever the rate of the recording."""
    columns = {name: recording.signal(name) for name in _SLOW_SIGNALS if recording.has(name)}
    if not columns:
        return []
    unknown = np.full((len(recording.stamps_ns), 1), np.nan)
    voltage, current, charge = (columns.get(name, unknown)[:, 0].tolist() for name in _SLOW_SIGNALS[:3])
    motor = columns["motor_temperature"].tolist() if "motor_temperature" in columns else None
    slots = recording.stamps_ns // SLOW_PERIOD_NS
    chosen = np.flatnonzero(np.diff(slots, prepend=slots[0] - 1))
    records: list[Record] = []
    for i in chosen.tolist():
        stamp_ns = int(recording.stamps_ns[i])
        temperature = dict(zip(recording.mapping.joint_names, motor[i], strict=True)) if motor else {}
        records.append(
            log_pb2.SlowState(
                robot_stamp_ns=stamp_ns,
                host_stamp_ns=stamp_ns,
                motors_powered=True,
                battery_charge_percent=charge[i],
                battery_voltage_v=voltage[i],
                battery_current_a=current[i],
                motor_temperature_c=temperature,
            )
        )
    return records
