"""The vendor's time sync: samples for our own estimate of the robot's clock, and the identifier of every command."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, Final, TypeVar

from bosdyn.api import time_sync_pb2
from bosdyn.client.common import BaseClient
from bosdyn.client.lease import add_lease_wallet_processors
from bosdyn.client.robot_command import NoTimeSyncError, RobotCommandClient
from bosdyn.client.time_sync import TimeSyncClient

from spot_model.robot.facts import NS_PER_S
from spot_runtime.hal.errors import ClockError
from spot_runtime.host.clock import ClockSample, HostClock

T = TypeVar("T")

ATTEMPTS: Final = 40
"""Round trips within which a sync is established, or is given up."""


class TimeSync:
    """Does round trips, one at a time.

    The service wants the client's UNIX stamps and gives its own estimate. We take the robot's two stamps of each
    answer and compare them with the host clock that never jumps.
    """

    def __init__(self, client: TimeSyncClient, clock: HostClock, timeout_s: float) -> None:
        self._client = client
        self._clock = clock
        self.timeout_s = timeout_s
        self._renewal_ns = round(timeout_s * NS_PER_S)
        self._previous: Any = None
        self._lock = threading.RLock()
        self.clock_identifier = ""
        """The service's name for this client, which commands carry; empty before the first answer."""
        self.status: int = time_sync_pb2.TimeSyncState.STATUS_UNKNOWN
        """The service's own word about the sync."""

    def round_trip(self) -> ClockSample:
        """Ask once. Raises the SDK's errors.

        The wall clock may be set while the answer is under way, so durations come from the clock that never jumps.
        """
        with self._lock:
            return self._round_trip(self.clock_identifier, self.timeout_s)

    def renew(self, unknown: str) -> None:
        """Begin again as a new client, for a robot that does not know this identifier (any more).

        Takes no longer than the first time-out and the round trip of another thread, which may come between two of
        these. Does nothing where another thread has renewed it. Raises the SDK's errors.
        """
        until_ns, has_begun = self._clock.now_ns() + self._renewal_ns, False
        for _ in range(ATTEMPTS):
            with self._lock:
                has_begun = has_begun or self.clock_identifier != unknown
                if has_begun and self.is_established:
                    return
                left_s = (until_ns - self._clock.now_ns()) / NS_PER_S
                if left_s <= 0.0:
                    return
                self._round_trip(self.clock_identifier if has_begun else "", min(self.timeout_s, left_s))
                has_begun = True

    def _round_trip(self, identifier: str, timeout_s: float) -> ClockSample:
        began_ns = self._clock.now_ns()
        host_from_unix_ns = began_ns - time.time_ns()
        previous = self._previous if identifier else None  # one without the other is an invalid request
        response = self._client.get_time_sync_update(previous, identifier, timeout=timeout_s)
        ended_ns = self._clock.now_ns()
        header = response.header
        if not (header.HasField("request_received_timestamp") and header.HasField("response_timestamp")):
            raise ClockError("the robot's answer bears no stamps, so its clock is not known; see the robot's own page")
        sent_unix_ns = _ns(header.request_header.request_timestamp)
        sent_ns = min(max(sent_unix_ns + host_from_unix_ns, began_ns), ended_ns)
        trip = time_sync_pb2.TimeSyncRoundTrip()
        trip.client_tx.CopyFrom(header.request_header.request_timestamp)
        trip.server_rx.CopyFrom(header.request_received_timestamp)
        trip.server_tx.CopyFrom(header.response_timestamp)
        trip.client_rx.seconds, trip.client_rx.nanos = divmod(sent_unix_ns + ended_ns - sent_ns, NS_PER_S)
        self._previous, self.clock_identifier = trip, str(response.clock_identifier)
        self.status = int(response.state.status)
        return ClockSample(sent_ns, _ns(trip.server_rx), _ns(trip.server_tx), ended_ns)

    @property
    def is_established(self) -> bool:
        """Whether the service calls the clocks synced."""
        return bool(self.status == time_sync_pb2.TimeSyncState.STATUS_OK)


class SyncedCommandClient(RobotCommandClient):  # type: ignore[misc]
    """The SDK's command client with a time sync that has an answer already.

    The SDK's own begins another time sync in a thread when it is made, and its first command leaves before the first
    answer, without the identifier that a robot may insist on (STATUS_NO_TIMESYNC).
    """

    def update_from(self, other: Any) -> None:
        """Like the SDK's, but it begins no time sync."""
        BaseClient.update_from(self, other)
        if self.lease_wallet:
            add_lease_wallet_processors(self, self.lease_wallet)

    def use(self, time_sync: TimeSync) -> None:
        """Send the clock identifier of this time sync with every command."""
        self._timesync_endpoint = time_sync

    def synced(self, send: Callable[[], T]) -> T:
        """Send a command; to a robot that has forgotten this client, as one that was rebooted has, once more."""
        identifier = self._timesync_endpoint.clock_identifier
        try:
            return send()
        except NoTimeSyncError:
            self._timesync_endpoint.renew(identifier)
        return send()


def _ns(stamp: Any) -> int:
    return int(stamp.seconds) * NS_PER_S + int(stamp.nanos)
