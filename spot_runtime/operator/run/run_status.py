"""What the control process tells of itself a few times a second."""

from __future__ import annotations

from typing import Final

import numpy as np

from spot_log.write.sink import SinkHealth
from spot_model.policy.policy import Policy
from spot_model.robot.facts import Array
from spot_model.robot.rotation import rotate_inverse_wxyz, tilt_rad
from spot_model.robot.state import RobotState, SlowState
from spot_protos import operator_pb2
from spot_runtime.control.loop import ControlLoop
from spot_runtime.control.loop_stats import LoopStats, RecentValues, percentile

STATUS_PERIOD_NS: Final = 200_000_000
RECENT: Final = 250
"""Ticks that the ages cover: five seconds."""

STANDING_BY: Final = "standing by"


def status_of(
    *,
    robot_id: str,
    policy: Policy,
    loop: ControlLoop | None,
    state: RobotState | None,
    slow: SlowState | None,
    log_path: str,
    log: SinkHealth,
) -> operator_pb2.RunStatus:
    """One status. ``loop`` is None while the vendor's controller stands."""
    contract = policy.contract
    status = operator_pb2.RunStatus(
        mode=STANDING_BY if loop is None else loop.mode.value,
        robot_id=robot_id,
        policy=contract.name,
        policy_sha256=policy.sha256,
        velocity_command=[0.0, 0.0, 0.0] if loop is None else loop.status.command.tolist(),
        velocity_command_low=contract.velocity_command_low,
        velocity_command_high=contract.velocity_command_high,
        log_path=log_path,
        log_dropped=sum(log.dropped.values()),
        log_problem=log.problem,
    )
    if loop is not None:
        status.active_s = loop.status.active_s
        _add_figures(status, loop.stats)
    if state is not None:
        status.tilt_rad = float(tilt_rad(state.odom_from_body_wxyz))
        status.velocity_measured.extend(_velocity_in_body(state).tolist())
    if slow is not None:
        _add_slow(status, slow)
    return status


def _add_figures(status: operator_pb2.RunStatus, stats: LoopStats) -> None:
    status.ticks, status.skipped_ticks = stats.ticks, stats.skipped_ticks
    status.rate_hz = stats.rate_hz if stats.ticks > 1 else 0.0
    status.state_age_p50_s, status.state_age_p99_s = _recent(stats.state_age_s)
    status.compute_p50_s, status.compute_p99_s = _recent(stats.compute_s)


def _recent(values: RecentValues) -> tuple[float, float]:
    newest = values.newest(RECENT)
    if not newest.size:
        return 0.0, 0.0
    return percentile(newest, 50.0), percentile(newest, 99.0)


def _velocity_in_body(state: RobotState) -> Array:
    linear = rotate_inverse_wxyz(state.odom_from_body_wxyz, state.linear_vel_of_body_in_odom_m_s)
    return np.array([linear[0], linear[1], state.angular_vel_of_body_in_odom_rad_s[2]])


def _add_slow(status: operator_pb2.RunStatus, slow: SlowState) -> None:
    status.motors_powered, status.estopped = slow.motors_powered, slow.estopped
    status.battery_charge_percent, status.battery_voltage_v = slow.battery_charge_percent, slow.battery_voltage_v
    status.motor_temperature_c.update(slow.motor_temperature_c)
    status.faults.extend([*slow.system_faults, *slow.behavior_faults, *slow.service_faults])
