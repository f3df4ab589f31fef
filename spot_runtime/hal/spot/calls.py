"""Single calls to a robot through the SDK, with its errors turned into ours, and the lease that they carry."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, Final, TypeVar

import grpc
from bosdyn.client.exceptions import LeaseUseError, RpcError
from bosdyn.client.lease import LeaseClient, LeaseWallet, ResourceAlreadyClaimedError

from spot_runtime.hal.errors import CredentialsError, HalError
from spot_runtime.hal.spot.vendor_errors import SDK_ERRORS, code_of, translate

T = TypeVar("T")

LOGIN_PERIOD_S: Final = 5.0
"""Host time between two attempts to log in again: a robot locks out a client that tries too often."""

TURNED_AWAY: Final = (grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.RESOURCE_EXHAUSTED)
"""Codes of a call that did not reach its service: a connection that was just closed, or too many calls at once."""

RETRY_PAUSES_S: Final = (0.05, 0.25)
"""Host time before such a call is made again. An e-stop endpoint or a lease is silent for no longer than this."""


def patiently(call: Callable[[], T], pause: Callable[[float], None] = time.sleep) -> T:
    """Make a call, and make it again while it is turned away, which says nothing of what was asked.

    Raises the SDK's and gRPC's errors: any other at once, the last of these after so many pauses.
    """
    for pause_s in RETRY_PAUSES_S:
        try:
            return call()
        except SDK_ERRORS as error:
            if code_of(error) not in TURNED_AWAY:
                raise
        pause(pause_s)
    return call()


class Calls:
    """Finds the SDK's clients and makes calls. Every method raises HalError and nothing else.

    A call that the robot refuses for the token's sake (it expired, or was revoked) is made once more after a login, and
    one that does not reach its service is made again.
    """

    def __init__(self, robot: Any = None, log_in: Callable[[], None] | None = None) -> None:
        """Use the SDK's robot and ``log_in`` to it; without a robot, every call says that there is no connection."""
        self._robot, self._log_in = robot, log_in
        self._lock = threading.Lock()
        self._next_login_s = 0.0
        self._logins = 0

    def client(self, kind: Any) -> Any:
        """The SDK's client of a service, given its class."""
        if self._robot is None:
            raise HalError("there is no connection to the robot; connect first")
        name = kind.default_service_name
        return self.make(f"finding {name}", lambda: self._robot.ensure_client(name))

    def make(self, doing: str, call: Callable[[], Any]) -> Any:
        """Make a call; ``doing`` says in errors what it was for."""
        logins = self._logins
        try:
            return patiently(call)
        except SDK_ERRORS as error:
            ours = translate(error, doing)
            if not (isinstance(ours, CredentialsError) and self._has_logged_in_since(logins)):
                raise ours from error
        try:
            return patiently(call)
        except SDK_ERRORS as error:
            raise translate(error, doing) from error

    def _has_logged_in_since(self, logins: int) -> bool:
        """Whether the token is newer than after so many logins; another thread's call may have fetched it."""
        with self._lock:
            if self._logins > logins:
                return True
            now_s = time.monotonic()
            if self._log_in is None or now_s < self._next_login_s:
                return False
            self._next_login_s = now_s + LOGIN_PERIOD_S
            try:
                self._log_in()
            except (*SDK_ERRORS, HalError):
                return False
            self._logins += 1
            return True


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
