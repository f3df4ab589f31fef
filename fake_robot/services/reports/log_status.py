"""LogStatusService: the logs that clients ask the robot to bundle. The fake keeps their times; nothing is in them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any, Final

from bosdyn.api.log_status.log_status_pb2 import LogStatus
from google.protobuf.duration_pb2 import Duration

from fake_robot.services.calls.stamps import (
    StatusValue,
    duration_from_ns,
    ns_from_duration,
    ns_from_timestamp,
    timestamp_from_ns,
)
from fake_robot.services.calls.unary import Answer, Call
from spot_model.robot.stamps import NS_PER_S

MAX_CONCURRENT = 8
MAX_KEPT = 256
MAX_SPAN_NS = 24 * 3600 * NS_PER_S


class LogBook:
    """The logs asked for, by number. Thread-safe."""

    def __init__(self, now_ns: Callable[[], int]) -> None:
        self.now_ns = now_ns
        self.lock = threading.Lock()
        self._logs: dict[str, LogStatus] = {}
        self._last = 0

    def get(self, log_id: str) -> LogStatus | None:
        """A log as it is now; None if there is none of that number."""
        log = self._logs.get(log_id)
        if log is not None:
            end_ns = ns_from_timestamp(log.end_time)
            if log.status == LogStatus.STATUS_IN_PROGRESS and end_ns <= self.now_ns():
                log.status = LogStatus.STATUS_DONE
            log.run_time.CopyFrom(duration_from_ns(min(self.now_ns(), end_ns) - ns_from_timestamp(log.start_time)))
        return log

    def active(self, kind: StatusValue = LogStatus.TYPE_UNKNOWN) -> list[LogStatus]:
        """The logs that still run, of one kind or of all."""
        logs = [self.get(log_id) for log_id in self._logs]
        return [x for x in logs if x and x.status == LogStatus.STATUS_IN_PROGRESS and kind in {0, x.type}]

    def add(self, kind: StatusValue, start_ns: int, end_ns: int) -> LogStatus:
        """Begin a log; the oldest is forgotten when there are too many."""
        self._last += 1
        log = LogStatus(id=f"log-{self._last}", type=kind, status=LogStatus.STATUS_IN_PROGRESS)
        log.start_time.CopyFrom(timestamp_from_ns(start_ns))
        log.end_time.CopyFrom(timestamp_from_ns(end_ns))
        self._logs[log.id] = log
        if len(self._logs) > MAX_KEPT:
            del self._logs[next(iter(self._logs))]
        return self.get(log.id) or log


def _start(kind: StatusValue) -> Answer:
    def answer(call: Call) -> None:
        book, response, now_ns = call.world.logs, call.response, call.world.now_ns()
        if book.active(LogStatus.TYPE_EXPERIMENT):
            response.status = response.STATUS_EXPERIMENT_LOG_RUNNING
        elif kind != LogStatus.TYPE_EXPERIMENT and len(book.active(kind)) >= MAX_CONCURRENT:
            response.status = response.STATUS_CONCURRENCY_LIMIT_REACHED
        elif kind == LogStatus.TYPE_RETRO:
            _tell(response, book.add(kind, now_ns - _span_ns(call.request.past_duration), now_ns))
        else:
            _tell(response, book.add(kind, now_ns, now_ns + _span_ns(call.request.keep_alive)))

    return answer


def _span_ns(duration: Duration) -> int:
    """The SDK asks for a retro log with a negative duration, where the proto means a positive one."""
    return min(abs(ns_from_duration(duration)), MAX_SPAN_NS)


def _get(call: Call) -> None:
    _tell(call.response, call.world.logs.get(call.request.id))


def _active(call: Call) -> None:
    call.response.log_statuses.extend(call.world.logs.active())
    call.response.status = call.response.STATUS_OK


def _update(call: Call) -> None:
    log = call.world.logs.get(call.request.id)
    if log is not None and log.status != LogStatus.STATUS_IN_PROGRESS:
        call.response.status = call.response.STATUS_LOG_TERMINATED
        return
    if log is not None:
        end_ns = call.world.now_ns() + _span_ns(call.request.keep_alive)
        log.end_time.CopyFrom(timestamp_from_ns(end_ns))
    _tell(call.response, log)


def _terminate(call: Call) -> None:
    log = call.world.logs.get(call.request.id)
    if log is not None and log.status == LogStatus.STATUS_IN_PROGRESS:
        log.status = LogStatus.STATUS_TERMINATED
        log.end_time.CopyFrom(timestamp_from_ns(call.world.now_ns()))
    _tell(call.response, log)


def _tell(response: Any, log: LogStatus | None) -> None:
    if log is None:
        response.status = response.STATUS_ID_NOT_FOUND
        return
    response.status = response.STATUS_OK
    response.log_status.CopyFrom(log)
    if "end_time" in response.DESCRIPTOR.fields_by_name:
        response.end_time.CopyFrom(log.end_time)


def _alone(answer: Answer) -> Answer:
    def locked(call: Call) -> None:
        with call.world.logs.lock:
            answer(call)

    return locked


ANSWERS: Final[Mapping[str, Answer]] = {
    name: _alone(answer)
    for name, answer in {
        "GetActiveLogStatuses": _active,
        "GetLogStatus": _get,
        "UpdateExperimentLog": _update,
        "TerminateLog": _terminate,
        "StartExperimentLog": _start(LogStatus.TYPE_EXPERIMENT),
        "StartRetroLog": _start(LogStatus.TYPE_RETRO),
        "StartConcurrentLog": _start(LogStatus.TYPE_CONCURRENT),
    }.items()
}
"""By method."""
