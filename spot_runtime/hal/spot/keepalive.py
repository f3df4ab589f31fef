"""A keepalive policy: a robot that no longer hears from this program sits down and cuts its motors' power by itself."""

from __future__ import annotations

from typing import Any, Final

from bosdyn.client.keepalive import KeepaliveClient, Policy

from spot_runtime.config import RobotConfig
from spot_runtime.hal.errors import HalError
from spot_runtime.hal.spot.calls import Calls
from spot_runtime.hal.spot.pace import Jobs

SILENT_S: Final = 10.0
"""Robot time without a check-in after which the robot acts: two slow calls and a repetition pass before."""


def watch_for_silence(calls: Calls, lease: Any, robot: RobotConfig, jobs: Jobs, now_s: float) -> str:
    """Have the robot watch for our silence while this lease (vendor's message) has it, and check in from now on.

    The policy is tied to the lease, so it needs no end: the robot drops it once the lease is returned or somebody else
    has one.

    Returns:
        Why the robot does not watch, in words; empty: it does. The guardian watches in either case.
    """
    policy = Policy()
    policy.name = robot.client_name
    policy.add_associated_lease(lease)
    policy.add_controlled_motors_off_action(SILENT_S)
    try:
        client = calls.client(KeepaliveClient)
        answer = calls.make(
            "adding a keepalive policy", lambda: client.modify_policy(to_add=policy, timeout=robot.rpc_timeout_s)
        )
    except HalError as error:
        return str(error)
    policy_id = answer.added_policy.policy_id

    def check_in() -> None:
        calls.make("checking in", lambda: client.check_in(policy_id, timeout=robot.rpc_timeout_s))

    jobs.add("keepalive", SILENT_S / 5.0, check_in, now_s=now_s)
    return ""
