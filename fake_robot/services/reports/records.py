"""What clients leave on the robot: service faults, events and comments in its log, and logs that they ask for."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

from bosdyn.api import (
    data_buffer_pb2,
    data_buffer_service_pb2,
    data_index_pb2,
    data_service_pb2,
    fault_service_pb2,
    robot_state_pb2,
)
from bosdyn.api.log_status import log_status_service_pb2
from bosdyn.api.log_status.log_status_pb2 import LogStatus
from bosdyn.api.service_fault_pb2 import ServiceFault, ServiceFaultId
from google.protobuf.duration_pb2 import Duration

from fake_robot.services.calls import Service, duration_from_ns, ns_of, refuse, timestamp_from_ns
from spot_model.robot.facts import NS_PER_S

MAX_FAULTS = 256
MAX_HISTORY = 32
MAX_ENTRIES = 1000
MAX_ENTRY_BYTES = 16 * 1024
MAX_SCHEMAS = 1000
MAX_SPAN_NS = 24 * 3600 * NS_PER_S

FaultKey = tuple[str, str, str]


class FaultService(Service):
    """Raises and clears service faults; GetRobotState shows them."""

    modules = (fault_service_pb2,)

    def __init__(self, now_ns: Callable[[], int]) -> None:
        super().__init__()
        self._now_ns = now_ns
        self._active: dict[FaultKey, ServiceFault] = {}
        self._history: deque[ServiceFault] = deque(maxlen=MAX_HISTORY)

    def TriggerServiceFault(self, request: Any, response: Any) -> None:  # noqa: N802
        """Raise a fault."""
        is_new = self.trigger(request.fault)
        response.status = response.STATUS_OK if is_new else response.STATUS_FAULT_ALREADY_ACTIVE

    def ClearServiceFault(self, request: Any, response: Any) -> None:  # noqa: N802
        """Clear one fault, or all of a service or of a payload."""
        wanted = request.fault_id

        def matches(fault: ServiceFaultId) -> bool:
            return (
                (request.clear_all_service_faults and fault.service_name == wanted.service_name)
                or (request.clear_all_payload_faults and fault.payload_guid == wanted.payload_guid)
                or _key(fault) == _key(wanted)
            )

        response.status = response.STATUS_OK if self.clear(matches) else response.STATUS_FAULT_NOT_ACTIVE

    def trigger(self, fault: ServiceFault) -> bool:
        """Raise a fault; False if it is active already."""
        with self.lock:
            key = _key(fault.fault_id)
            if key in self._active or len(self._active) >= MAX_FAULTS:
                return False
            fault.onset_timestamp.CopyFrom(timestamp_from_ns(self._now_ns()))
            self._active[key] = fault
            return True

    def clear(self, matches: Callable[[ServiceFaultId], bool]) -> bool:
        """Clear the faults that match; False if none does."""
        with self.lock:
            cleared = [key for key, fault in self._active.items() if matches(fault.fault_id)]
            for key in cleared:
                fault = self._active.pop(key)
                fault.duration.CopyFrom(duration_from_ns(self._now_ns() - ns_of(fault.onset_timestamp)))
                self._history.append(fault)
            return bool(cleared)

    def state(self) -> robot_state_pb2.ServiceFaultState:
        """Active and past faults, and the worst severity of each attribute."""
        with self.lock:
            active = self._active.values()
            state = robot_state_pb2.ServiceFaultState(faults=active, historical_faults=list(self._history))
            for fault in active:
                for attribute in fault.attributes:
                    state.aggregated[attribute] = max(state.aggregated[attribute], fault.severity)
            return state


def liveness_fault(service_name: str) -> ServiceFault:
    """The fault of a service that no longer refreshes its entry in the directory."""
    fault = ServiceFault(severity=ServiceFault.SEVERITY_CRITICAL)
    # The fake's name for it; the vendor publishes none.
    fault.fault_id.fault_name, fault.fault_id.service_name = "Service Liveness Fault", service_name
    fault.error_message = f"service {service_name} has not refreshed its directory entry within its liveness time-out"
    return fault


def _key(fault_id: ServiceFaultId) -> FaultKey:
    return fault_id.fault_name, fault_id.service_name, fault_id.payload_guid


class DataBufferService(Service):
    """Takes text, comments, events, blobs and signals; keeps the last few events and comments, to be read back."""

    modules = (data_buffer_service_pb2, data_service_pb2)

    def __init__(self, now_ns: Callable[[], int]) -> None:
        super().__init__()
        self._now_ns = now_ns
        self._events: deque[data_buffer_pb2.Event] = deque(maxlen=MAX_ENTRIES)
        self._comments: deque[data_buffer_pb2.OperatorComment] = deque(maxlen=MAX_ENTRIES)
        self._schemas: list[str] = []
        self._total_bytes = 0

    def RecordTextMessages(self, request: Any, response: Any) -> None:  # noqa: N802
        """Count text messages."""
        self._total_bytes += request.ByteSize()

    def RecordOperatorComments(self, request: Any, response: Any) -> None:  # noqa: N802
        """Keep comments of up to 16 KiB; one without a time gets the robot's."""
        self._total_bytes += request.ByteSize()
        for comment in request.operator_comments:
            if comment.ByteSize() <= MAX_ENTRY_BYTES:
                if not comment.HasField("timestamp"):
                    comment.timestamp.CopyFrom(timestamp_from_ns(self._now_ns()))
                self._comments.append(comment)

    def RecordDataBlobs(self, request: Any, response: Any) -> None:  # noqa: N802
        """Count blobs."""
        self._total_bytes += request.ByteSize()

    def RecordEvents(self, request: Any, response: Any) -> None:  # noqa: N802
        """Keep events of up to 16 KiB."""
        self._total_bytes += request.ByteSize()
        self.keep(event for event in request.events if event.ByteSize() <= MAX_ENTRY_BYTES)

    def RegisterSignalSchema(self, request: Any, response: Any) -> None:  # noqa: N802
        """Number a schema; the same name gets the same number."""
        name = request.schema.schema_name
        if name not in self._schemas:
            if len(self._schemas) >= MAX_SCHEMAS:
                refuse(response, f"more than {MAX_SCHEMAS} schemas")
                return
            self._schemas.append(name)
        response.schema_id = self._schemas.index(name) + 1

    def RecordSignalTicks(self, request: Any, response: Any) -> None:  # noqa: N802
        """Count ticks; one of an unknown schema is an error in the answer."""
        self._total_bytes += request.ByteSize()
        for index, tick in enumerate(request.tick_data):
            if not 1 <= tick.schema_id <= len(self._schemas):
                error = response.errors.add(index=index, message=f"no schema {tick.schema_id} is registered")
                error.type = error.INVALID_SCHEMA_ID

    def GetEventsComments(self, request: Any, response: Any) -> None:  # noqa: N802
        """Events and comments of a span of robot time, by the request's filters."""
        spec, found = request.event_comment_request, response.events_comments
        span = spec.time_range
        start_ns = ns_of(span.start) if span.HasField("start") else 0
        end_ns = ns_of(span.end) if span.HasField("end") else 1 << 63
        found.time_range.CopyFrom(span)
        for event in self._events:
            is_inside = start_ns <= ns_of(event.start_time) <= end_ns
            if is_inside and any(_matches(event, wanted) for wanted in spec.events):
                found.events.add().CopyFrom(event)
        for comment in self._comments:
            if spec.comments and start_ns <= ns_of(comment.timestamp) <= end_ns:
                found.operator_comments.add().CopyFrom(comment)

    def GetDataBufferStatus(self, request: Any, response: Any) -> None:  # noqa: N802
        """How much has been noted."""
        status = response.data_buffer_status
        status.num_comments, status.num_events = len(self._comments), len(self._events)
        status.data_buffer_total_bytes = self._total_bytes

    def GetDataIndex(self, request: Any, response: Any) -> None:  # noqa: N802
        """An empty index of the span that was asked for."""
        response.data_index.time_range.CopyFrom(request.data_query.time_range)

    def GetDataPages(self, request: Any, response: Any) -> None:  # noqa: N802
        """No pages."""

    def DeleteDataPages(self, request: Any, response: Any) -> None:  # noqa: N802
        """Nothing is deleted: each page asked for is reported as not found."""
        for page_id in request.page_ids:
            response.status.add(page_id=page_id, status=data_index_pb2.DeletePageStatus.STATUS_NOT_FOUND)

    def keep(self, events: Iterable[data_buffer_pb2.Event]) -> None:
        """Note events."""
        with self.lock:
            self._events.extend(events)


def _matches(event: data_buffer_pb2.Event, wanted: data_index_pb2.EventSpec) -> bool:
    return (
        wanted.source in {"", event.source}
        and wanted.type in {"", event.type}
        and (not wanted.HasField("level") or wanted.level.value == event.level)
    )


class LogStatusService(Service):
    """Keeps the times of the logs that clients ask the robot to bundle; nothing is in them."""

    modules = (log_status_service_pb2,)

    def __init__(self, now_ns: Callable[[], int]) -> None:
        super().__init__()
        self._now_ns = now_ns
        self._logs: dict[str, LogStatus] = {}
        self._last = 0

    def GetActiveLogStatuses(self, request: Any, response: Any) -> None:  # noqa: N802
        """The logs that still run."""
        response.log_statuses.extend(self._running())
        response.status = response.STATUS_OK

    def GetLogStatus(self, request: Any, response: Any) -> None:  # noqa: N802
        """A log as it is now."""
        self._tell(response, request.id)

    def UpdateExperimentLog(self, request: Any, response: Any) -> None:  # noqa: N802
        """Have a log end later."""
        log = self._log(request.id)
        if log is not None and log.status != LogStatus.STATUS_IN_PROGRESS:
            response.status = response.STATUS_LOG_TERMINATED
            return
        if log is not None:
            log.end_time.CopyFrom(timestamp_from_ns(self._now_ns() + _span_ns(request.keep_alive)))
        self._tell(response, request.id)

    def TerminateLog(self, request: Any, response: Any) -> None:  # noqa: N802
        """End a log now."""
        log = self._log(request.id)
        if log is not None and log.status == LogStatus.STATUS_IN_PROGRESS:
            log.status = LogStatus.STATUS_TERMINATED
            log.end_time.CopyFrom(timestamp_from_ns(self._now_ns()))
        self._tell(response, request.id)

    def StartExperimentLog(self, request: Any, response: Any) -> None:  # noqa: N802
        """Begin a log beside which no other may run."""
        self._begin(response, LogStatus.TYPE_EXPERIMENT, ahead_ns=_span_ns(request.keep_alive))

    def StartConcurrentLog(self, request: Any, response: Any) -> None:  # noqa: N802
        """Begin a log beside others."""
        self._begin(response, LogStatus.TYPE_CONCURRENT, ahead_ns=_span_ns(request.keep_alive))

    def StartRetroLog(self, request: Any, response: Any) -> None:  # noqa: N802
        """Make a log of what has been."""
        self._begin(response, LogStatus.TYPE_RETRO, back_ns=_span_ns(request.past_duration))

    def _begin(self, response: Any, kind: int, *, back_ns: int = 0, ahead_ns: int = 0) -> None:
        """Begin a log that reaches so far back and ahead; the oldest is forgotten when there are too many."""
        running, now_ns = [log.type for log in self._running()], self._now_ns()
        if LogStatus.TYPE_EXPERIMENT in running:
            response.status = response.STATUS_EXPERIMENT_LOG_RUNNING
        elif kind != LogStatus.TYPE_EXPERIMENT and running.count(kind) >= 8:
            response.status = response.STATUS_CONCURRENCY_LIMIT_REACHED
        else:
            self._last += 1
            log = LogStatus(id=f"log-{self._last}", type=kind, status=LogStatus.STATUS_IN_PROGRESS)
            log.start_time.CopyFrom(timestamp_from_ns(now_ns - back_ns))
            log.end_time.CopyFrom(timestamp_from_ns(now_ns + ahead_ns))
            self._logs[log.id] = log
            if len(self._logs) > 256:
                del self._logs[next(iter(self._logs))]
            self._tell(response, log.id)

    def _log(self, log_id: str) -> LogStatus | None:
        """A log as it is now; None if there is none of that number."""
        log = self._logs.get(log_id)
        if log is not None:
            end_ns = ns_of(log.end_time)
            if log.status == LogStatus.STATUS_IN_PROGRESS and end_ns <= self._now_ns():
                log.status = LogStatus.STATUS_DONE
            log.run_time.CopyFrom(duration_from_ns(min(self._now_ns(), end_ns) - ns_of(log.start_time)))
        return log

    def _running(self) -> list[LogStatus]:
        logs = [self._log(log_id) for log_id in self._logs]
        return [log for log in logs if log is not None and log.status == LogStatus.STATUS_IN_PROGRESS]

    def _tell(self, response: Any, log_id: str) -> None:
        log = self._log(log_id)
        if log is None:
            response.status = response.STATUS_ID_NOT_FOUND
            return
        response.status = response.STATUS_OK
        response.log_status.CopyFrom(log)
        if "end_time" in response.DESCRIPTOR.fields_by_name:
            response.end_time.CopyFrom(log.end_time)


def _span_ns(duration: Duration) -> int:
    """The SDK asks for a retro log with a negative duration, where the proto means a positive one."""
    return min(abs(ns_of(duration)), MAX_SPAN_NS)
