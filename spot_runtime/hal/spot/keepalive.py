"""A keepalive policy: a robot that no longer hears from this program sits down and cuts its motors' power by itself."""

from __future__ import annotations

from typing import Any, Final

from bosdyn.client.keepalive import KeepaliveClient, Policy

from spot_runtime.hal.errors import NoServiceError
from spot_runtime.hal.spot.calls import Calls

SILENT_S: Final = 10.0
"""Robot time without a check-in after which the robot acts: two slow calls and a repetition pass before."""

CHECK_IN_PERIOD_S: Final = SILENT_S / 5.0


class Keepalive:
    """One policy of ours on the robot. Every method raises HalError and nothing else.

    It is tied to a lease, so it needs no end: the robot drops it once that lease is returned or somebody else has one.
    """

    def __init__(self, calls: Calls, timeout_s: float) -> None:
        """Use these calls; nothing is sent yet."""
        self._calls, self._timeout_s = calls, timeout_s
        self._policy_id = 0

    def begin(self, name: str, lease: Any) -> bool:
        """Have the robot watch for our silence while this lease (vendor's message) has it.

        Returns:
            Whether it does; a robot with older software has no such service, and the guardian alone watches.
        """
        policy = Policy()
        policy.name = name
        policy.add_associated_lease(lease)
        policy.add_controlled_motors_off_action(SILENT_S)
        try:
            client = self._calls.client(KeepaliveClient)
        except NoServiceError:
            return False
        answer = self._calls.make(
            "adding a keepalive policy", lambda: client.modify_policy(to_add=policy, timeout=self._timeout_s)
        )
        self._policy_id = answer.added_policy.policy_id
        return True

    def check_in(self) -> None:
        """Let the robot hear from us."""
        client = self._calls.client(KeepaliveClient)
        self._calls.make("checking in", lambda: client.check_in(self._policy_id, timeout=self._timeout_s))
