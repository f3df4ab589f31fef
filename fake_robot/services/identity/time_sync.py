"""TimeSyncService: how far the robot's clock is from the client's."""

from __future__ import annotations

from typing import Any

from bosdyn.api import time_sync_pb2

from fake_robot.services.calls.stamps import duration_from_ns, ns_from_timestamp, timestamp_from_ns
from fake_robot.services.identity.time_sync_clients import Sample, TimeSyncClients, sample_from_round_trip


class TimeSyncService:
    """Turns the round trips that a client reports into an estimate of the clock skew."""

    def __init__(self, records: TimeSyncClients) -> None:
        self._records = records

    def TimeSyncUpdate(self, request: Any) -> Any:  # noqa: N802
        """Take the last round trip into account and answer with the best estimate so far.

        A client starts without an identifier. An unknown one (from before a reboot) is replaced by a new one.
        """
        response = time_sync_pb2.TimeSyncUpdateResponse()
        if not self._records.is_ready:
            response.state.status = time_sync_pb2.TimeSyncState.STATUS_SERVICE_NOT_READY
            return response
        identifier = self._records.client(request.clock_identifier)
        response.clock_identifier = identifier
        if request.HasField("previous_round_trip") and identifier == request.clock_identifier:
            sample = _sample(request.previous_round_trip)
            self._records.add(identifier, sample)
            _fill(response.previous_estimate, sample)
        best = self._records.best(identifier)
        if best is None:
            response.state.status = time_sync_pb2.TimeSyncState.STATUS_MORE_SAMPLES_NEEDED
            return response
        response.state.status = time_sync_pb2.TimeSyncState.STATUS_OK
        _fill(response.state.best_estimate, best)
        response.state.measurement_time.CopyFrom(timestamp_from_ns(best.robot_stamp_ns))
        return response


def _sample(trip: time_sync_pb2.TimeSyncRoundTrip) -> Sample:
    return sample_from_round_trip(
        ns_from_timestamp(trip.client_tx),
        ns_from_timestamp(trip.server_rx),
        ns_from_timestamp(trip.server_tx),
        ns_from_timestamp(trip.client_rx),
    )


def _fill(estimate: time_sync_pb2.TimeSyncEstimate, sample: Sample) -> None:
    estimate.round_trip_time.CopyFrom(duration_from_ns(sample.round_trip_ns))
    estimate.clock_skew.CopyFrom(duration_from_ns(sample.clock_skew_ns))
