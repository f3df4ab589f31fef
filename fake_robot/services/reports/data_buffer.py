"""DataBufferService and DataService: what clients note in the robot's log. The fake keeps the last few in memory."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from bosdyn.api import (
    data_buffer_pb2,
    data_index_pb2,
)

from fake_robot.services.calls.access import refuse_request
from fake_robot.services.calls.stamps import ns_from_timestamp, timestamp_from_ns

MAX_ENTRIES = 1000
MAX_ENTRY_BYTES = 16 * 1024
MAX_SCHEMAS = 1000


@dataclass
class DataBuffer:
    """Events and comments, oldest first, and how many bytes came in all. Thread-safe."""

    robot_now_ns: Callable[[], int]
    events: deque[data_buffer_pb2.Event] = field(default_factory=lambda: deque(maxlen=MAX_ENTRIES))
    comments: deque[data_buffer_pb2.OperatorComment] = field(default_factory=lambda: deque(maxlen=MAX_ENTRIES))
    schemas: list[str] = field(default_factory=list)
    total_bytes: int = 0
    lock: threading.Lock = field(default_factory=threading.Lock)


class DataBufferService:
    """Accepts text, comments, events, blobs and signals."""

    def __init__(self, notes: DataBuffer) -> None:
        self._notes = notes

    def RecordTextMessages(self, request: Any) -> Any:  # noqa: N802
        """Count text messages."""
        self._count(request.ByteSize())
        return data_buffer_pb2.RecordTextMessagesResponse()

    def RecordOperatorComments(self, request: Any) -> Any:  # noqa: N802
        """Keep comments of up to 16 KiB; one without a time gets the robot's."""
        self._count(request.ByteSize())
        with self._notes.lock:
            for comment in request.operator_comments:
                if comment.ByteSize() > MAX_ENTRY_BYTES:
                    continue
                if not comment.HasField("timestamp"):
                    comment.timestamp.CopyFrom(timestamp_from_ns(self._notes.robot_now_ns()))
                self._notes.comments.append(comment)
        return data_buffer_pb2.RecordOperatorCommentsResponse()

    def RecordDataBlobs(self, request: Any) -> Any:  # noqa: N802
        """Count blobs."""
        self._count(request.ByteSize())
        return data_buffer_pb2.RecordDataBlobsResponse()

    def RecordEvents(self, request: Any) -> Any:  # noqa: N802
        """Keep events of up to 16 KiB."""
        self._count(request.ByteSize())
        with self._notes.lock:
            self._notes.events.extend(event for event in request.events if event.ByteSize() <= MAX_ENTRY_BYTES)
        return data_buffer_pb2.RecordEventsResponse()

    def RegisterSignalSchema(self, request: Any) -> Any:  # noqa: N802
        """Number a schema; the same name gets the same number."""
        with self._notes.lock:
            name = request.schema.schema_name
            if name not in self._notes.schemas:
                if len(self._notes.schemas) >= MAX_SCHEMAS:
                    return refuse_request(
                        data_buffer_pb2.RegisterSignalSchemaResponse(), f"more than {MAX_SCHEMAS} schemas"
                    )
                self._notes.schemas.append(name)
            return data_buffer_pb2.RegisterSignalSchemaResponse(schema_id=self._notes.schemas.index(name) + 1)

    def RecordSignalTicks(self, request: Any) -> Any:  # noqa: N802
        """Count ticks; one of an unknown schema is an error in the answer."""
        self._count(request.ByteSize())
        response = data_buffer_pb2.RecordSignalTicksResponse()
        for index, tick in enumerate(request.tick_data):
            if not 1 <= tick.schema_id <= len(self._notes.schemas):
                error = response.errors.add(index=index, message=f"no schema {tick.schema_id} is registered")
                error.type = data_buffer_pb2.RecordSignalTicksResponse.Error.INVALID_SCHEMA_ID
        return response

    def _count(self, n_bytes: int) -> None:
        with self._notes.lock:
            self._notes.total_bytes += n_bytes


class DataService:
    """Reads events and comments back. There are no pages to download."""

    def __init__(self, notes: DataBuffer) -> None:
        self._notes = notes

    def GetEventsComments(self, request: Any) -> Any:  # noqa: N802
        """Events and comments of a span of robot time, by the request's filters."""
        spec = request.event_comment_request
        start_ns = ns_from_timestamp(spec.time_range.start) if spec.time_range.HasField("start") else 0
        end_ns = ns_from_timestamp(spec.time_range.end) if spec.time_range.HasField("end") else 1 << 63
        response = data_index_pb2.GetEventsCommentsResponse()
        found = response.events_comments
        found.time_range.CopyFrom(spec.time_range)
        with self._notes.lock:
            for event in self._notes.events:
                is_inside = start_ns <= ns_from_timestamp(event.start_time) <= end_ns
                if is_inside and any(_matches(event, wanted) for wanted in spec.events):
                    found.events.add().CopyFrom(event)
            if spec.comments:
                for comment in self._notes.comments:
                    if start_ns <= ns_from_timestamp(comment.timestamp) <= end_ns:
                        found.operator_comments.add().CopyFrom(comment)
        return response

    def GetDataBufferStatus(self, request: Any) -> Any:  # noqa: N802
        """How much has been noted."""
        response = data_index_pb2.GetDataBufferStatusResponse()
        with self._notes.lock:
            response.data_buffer_status.num_comments = len(self._notes.comments)
            response.data_buffer_status.num_events = len(self._notes.events)
            response.data_buffer_status.data_buffer_total_bytes = self._notes.total_bytes
        return response

    def GetDataIndex(self, request: Any) -> Any:  # noqa: N802
        """An empty index of the span that was asked for."""
        response = data_index_pb2.GetDataIndexResponse()
        response.data_index.time_range.CopyFrom(request.data_query.time_range)
        return response

    def GetDataPages(self, request: Any) -> Any:  # noqa: N802
        """No pages."""
        return data_index_pb2.GetDataPagesResponse()

    def DeleteDataPages(self, request: Any) -> Any:  # noqa: N802
        """Nothing is deleted: each page asked for is reported as not found."""
        response = data_index_pb2.DeleteDataPagesResponse()
        for page_id in request.page_ids:
            response.status.add(page_id=page_id, status=data_index_pb2.DeletePageStatus.STATUS_NOT_FOUND)
        return response


def _matches(event: data_buffer_pb2.Event, wanted: data_index_pb2.EventSpec) -> bool:
    return (
        wanted.source in {"", event.source}
        and wanted.type in {"", event.type}
        and (not wanted.HasField("level") or wanted.level.value == event.level)
    )
