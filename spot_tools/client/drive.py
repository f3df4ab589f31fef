"""Steering from a keyboard or a gamepad, wherever the operator sits."""

from __future__ import annotations

import time
from typing import Final

from spot_protos import operator_pb2
from spot_runtime.sources.base import CommandSource
from spot_tools.client.client import OperatorClient, RefusedError

PERIOD_S: Final = 0.04


def drive_by(client: OperatorClient, source: CommandSource, operator: str) -> None:
    """Send what the source says until it is finished; then stop the robot in place and let it sit.

    A velocity beyond the policy's range is cut to it. While the policy is not in full control nothing is sent but
    that somebody attends.
    """
    began_ns = time.monotonic_ns()
    try:
        while True:
            now_ns = time.monotonic_ns()
            wanted = source.sample((now_ns - began_ns) / 1e9, now_ns)
            if wanted.is_finished:
                client.call("Stop", operator_pb2.StopRequest())
                return
            _steer(client, wanted.command.tolist(), operator)
            time.sleep(PERIOD_S)
    finally:
        source.close()


def _steer(client: OperatorClient, velocity: list[float], operator: str) -> None:
    run = client.call("GetStatus", operator_pb2.GetStatusRequest()).run
    if run.mode != "active":
        client.call("Attend", operator_pb2.AttendRequest())
        return
    low, high = run.velocity_command_low, run.velocity_command_high
    v_x, v_y, yaw = (min(max(v, lo), hi) for v, lo, hi in zip(velocity, low, high, strict=True))
    request = operator_pb2.SetVelocityRequest(v_x_m_s=v_x, v_y_m_s=v_y, yaw_rate_rad_s=yaw, operator=operator)
    try:
        client.call("SetVelocity", request, 2.0)
    except RefusedError:
        client.call("Attend", operator_pb2.AttendRequest())  # the mode has just changed
