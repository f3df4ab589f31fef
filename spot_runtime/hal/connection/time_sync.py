"""Round trips of the vendor's time-sync service, as samples for our own estimate of the robot's clock."""

from __future__ import annotations

import time
from typing import Any, Final

from bosdyn.api import time_sync_pb2
from bosdyn.client.time_sync import TimeSyncClient

from spot_runtime.host.clock import ClockSample, HostClock

NS_PER_S: Final = 1_000_000_000


class TimeSync:
    """Does round trips; for one thread.

    The service wants the client's UNIX stamps and gives its own estimate. We take the robot's two stamps of each
    answer and compare them with the host clock that never jumps.
    """

    def __init__(self, client: TimeSyncClient, clock: HostClock, timeout_s: float) -> None:
        """Use an SDK client of the service."""
        self._client = client
        self._clock = clock
        self.timeout_s = timeout_s
        self._previous: Any = None
        self._identifier = ""
        self.status = "no answer yet"
        """The service's own word about the sync."""

    def round_trip(self) -> ClockSample:
        """Ask once. Raises the SDK's errors."""
        host_from_unix_ns = self._clock.now_ns() - time.time_ns()
        response = self._client.get_time_sync_update(self._previous, self._identifier, timeout=self.timeout_s)
        received_unix_ns = time.time_ns()
        header = response.header
        trip = time_sync_pb2.TimeSyncRoundTrip()
        trip.client_tx.CopyFrom(header.request_header.request_timestamp)
        trip.server_rx.CopyFrom(header.request_received_timestamp)
        trip.server_tx.CopyFrom(header.response_timestamp)
        trip.client_rx.seconds, trip.client_rx.nanos = divmod(received_unix_ns, NS_PER_S)
        self._previous, self._identifier = trip, response.clock_identifier
        self.status = time_sync_pb2.TimeSyncState.Status.Name(response.state.status)
        return ClockSample(
            host_sent_ns=_ns(trip.client_tx) + host_from_unix_ns,
            robot_received_ns=_ns(trip.server_rx),
            robot_sent_ns=_ns(trip.server_tx),
            host_received_ns=received_unix_ns + host_from_unix_ns,
        )

    @property
    def is_established(self) -> bool:
        """Whether the service calls the clocks synced."""
        return self.status == "STATUS_OK"


def _ns(stamp: Any) -> int:
    return int(stamp.seconds) * NS_PER_S + int(stamp.nanos)
