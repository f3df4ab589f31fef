"""The lease of the body: taking it although an answer gets lost, keeping it although a command overtakes."""

from __future__ import annotations

from typing import Any, Final

import grpc
from bosdyn.client.exceptions import LeaseUseError, RpcError
from bosdyn.client.lease import LeaseClient, LeaseWallet, ResourceAlreadyClaimedError

BODY: Final = "body"
"""The resource whose lease commands need."""


def newest_lease(client: LeaseClient, resource: str, timeout_s: float, owner: str = "") -> Any:
    """The newest lease that the robot knows of, of one owner or anybody; None if there is none.

    Raises the SDK's errors.
    """
    listed = client.list_leases(include_full_lease_info=True, timeout=timeout_s)
    found = (r for r in listed if r.resource == resource and r.lease.sequence)
    return next((r.lease for r in found if owner in ("", r.lease_owner.client_name)), None)


class Acquisition:
    """Takes the lease if it is free, or ours by a call whose answer was lost."""

    def __init__(self, client: LeaseClient, our_name: str, timeout_s: float) -> None:
        """Use the SDK's client, by which the robot knows us under this name."""
        self._client, self._our_name, self._timeout_s = client, our_name, timeout_s
        self._is_unanswered = False

    def ask(self) -> Any:
        """The lease, in the vendor's message; may be called again. Raises the SDK's errors."""
        try:
            return self._client.acquire(BODY, timeout=self._timeout_s).lease_proto
        except RpcError as error:
            is_second, self._is_unanswered = self._is_unanswered, True
            if is_second or error.error.code() is not grpc.StatusCode.DEADLINE_EXCEEDED:
                raise
        except ResourceAlreadyClaimedError:
            # Only after such a call: another of our sessions in this process has the same name.
            if not self._is_unanswered:
                raise
            ours = newest_lease(self._client, BODY, self._timeout_s, self._our_name)
            if ours is None:
                raise
            return ours
        return self.ask()


def retain(client: LeaseClient, wallet: LeaseWallet, timeout_s: float) -> None:
    """Keep the wallet's lease alive. Raises the SDK's errors."""
    lease = wallet.get_lease(BODY)
    try:
        client.retain_lease(lease, timeout=timeout_s)
    except LeaseUseError:
        if wallet.get_lease(BODY) is lease:
            raise
        retain(client, wallet, timeout_s)  # a command, which bears a newer lease, has overtaken it
