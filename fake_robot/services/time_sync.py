"""TimeSyncService: how far the robot's clock is ahead of each client's, from the round trips that clients report."""

from __future__ import annotations

import secrets
from collections import OrderedDict, deque
from typing import Any, NamedTuple

from bosdyn.api import time_sync_pb2, time_sync_service_pb2

from fake_robot.services.calls import Service, duration_from_ns, ns_of, timestamp_from_ns

MAX_CLIENTS = 256
MAX_SAMPLES = 25


class RoundTrip(NamedTuple):
    """How long it took, and how far the robot's clock is ahead of the client's. Nanoseconds."""

    round_trip_ns: int
    clock_skew_ns: int
    robot_stamp_ns: int

    def fill(self, estimate: time_sync_pb2.TimeSyncEstimate) -> None:
        """Tell a client of it."""
        estimate.round_trip_time.CopyFrom(duration_from_ns(self.round_trip_ns))
        estimate.clock_skew.CopyFrom(duration_from_ns(self.clock_skew_ns))


def round_trip(trip: time_sync_pb2.TimeSyncRoundTrip) -> RoundTrip:
    """Estimate skew and duration as NTP does: the way there and the way back are taken to be equally long."""
    client_tx_ns, server_rx_ns, server_tx_ns, client_rx_ns = map(
        ns_of, (trip.client_tx, trip.server_rx, trip.server_tx, trip.client_rx)
    )
    round_trip_ns = (client_rx_ns - client_tx_ns) - (server_tx_ns - server_rx_ns)
    clock_skew_ns = ((server_rx_ns - client_tx_ns) + (server_tx_ns - client_rx_ns)) // 2
    return RoundTrip(round_trip_ns, clock_skew_ns, server_tx_ns)


class TimeSyncService(Service):
    """Keeps the last 25 round trips of each client.

    The best estimate is the newest one of the shortest round trip among them. In lock-step, where the robot's clock
    stands still between steps, only the newest counts.
    """

    modules = (time_sync_service_pb2,)

    def __init__(self, needed_samples: int, *, uses_newest: bool) -> None:
        super().__init__()
        self.is_ready = True
        self._needed_samples, self._uses_newest = needed_samples, uses_newest
        self._clients: OrderedDict[str, deque[RoundTrip]] = OrderedDict()

    def TimeSyncUpdate(self, request: Any, response: Any) -> None:  # noqa: N802
        """Take the last round trip into account and answer with the best estimate so far.

        A client starts without an identifier. An unknown one (from before a reboot) is replaced by a new one.
        """
        state = response.state
        if not self.is_ready:
            state.status = state.STATUS_SERVICE_NOT_READY
            return
        response.clock_identifier = self._identifier(request.clock_identifier)
        trips = self._clients[response.clock_identifier]
        if request.HasField("previous_round_trip") and response.clock_identifier == request.clock_identifier:
            trip = round_trip(request.previous_round_trip)
            if trip.round_trip_ns >= 0:  # a negative duration is no measurement
                trips.append(trip)
            trip.fill(response.previous_estimate)
        if len(trips) < self._needed_samples:
            state.status = state.STATUS_MORE_SAMPLES_NEEDED
            return
        best = trips[-1] if self._uses_newest else min(reversed(trips), key=lambda trip: trip.round_trip_ns)
        state.status = state.STATUS_OK
        best.fill(state.best_estimate)
        state.measurement_time.CopyFrom(timestamp_from_ns(best.robot_stamp_ns))

    def is_established(self, clock_identifier: str) -> bool:
        """Whether the identifier was given to a client, and that client has reported enough round trips."""
        with self.lock:
            return len(self._clients.get(clock_identifier, ())) >= self._needed_samples

    def reset(self) -> None:
        """Forget every client, as a reboot does."""
        with self.lock:
            self._clients.clear()

    def _identifier(self, told: str) -> str:
        """The identifier itself if it is known, else a new one."""
        if told in self._clients:
            self._clients.move_to_end(told)
            return told
        identifier = f"spot-time-sync-{secrets.token_hex(8)}"
        self._clients[identifier] = deque(maxlen=MAX_SAMPLES)
        if len(self._clients) > MAX_CLIENTS:
            self._clients.popitem(last=False)
        return identifier
