"""A robot that stands, for as long as a check needs it; afterwards it sits without power, whatever happened."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from bosdyn.api import lease_pb2
from bosdyn.client.lease import LeaseKeepAlive
from bosdyn.client.robot_command import blocking_stand

from fake_robot.conformance.server import MOTION_TIMEOUT_S, Server, SkippedError


@contextlib.contextmanager
def powered(server: Server) -> Iterator[lease_pb2.Lease]:
    """Acquire the lease, power on, stand; at the end sit, power off, return the lease.

    Raises:
        SkippedError: Somebody holds the lease, or the e-stop is pressed.
    """
    robot = server.robot
    if robot.is_estopped():
        raise SkippedError("the e-stop is pressed")
    if robot.is_powered_on():
        raise SkippedError("the motors are on already")
    with server.lease(), LeaseKeepAlive(robot.ensure_client("lease"), return_at_exit=False):
        try:
            robot.power_on(timeout_sec=MOTION_TIMEOUT_S)
            blocking_stand(robot.ensure_client("robot-command"), timeout_sec=MOTION_TIMEOUT_S)
            # The commands so far went out under newer sub-leases, so the one that was granted is too old.
            yield robot.lease_wallet.advance("body").lease_proto
        finally:
            robot.power_off(cut_immediately=False, timeout_sec=MOTION_TIMEOUT_S)
