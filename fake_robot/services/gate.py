"""What every call passes on its way in and out: the link, the user token, the response header."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import grpc
from bosdyn.api import header_pb2

from fake_robot.services.auth import AuthService
from fake_robot.services.calls import timestamp_from_ns
from fake_robot.services.directory import TOKENLESS_TYPES

_BEARER = "Bearer "

Handler = Callable[[Any, grpc.ServicerContext], Any]


@dataclass
class Link:
    """The network between the clients and the robot. Thread-safe.

    Cuts are measured on the host's clock: in lock-step a cut-off client could not let robot time pass.
    """

    host_now_ns: Callable[[], int] = time.monotonic_ns
    _down_until_ns: int = 0
    _reason: str = ""
    _streams: list[tuple[str, Callable[[], None]]] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def cut(self, duration_s: float, reason: str) -> None:
        """Refuse every call for ``duration_s`` host seconds, and end the open streams."""
        with self._lock:
            self._down_until_ns = self.host_now_ns() + round(duration_s * 1e9)
            self._reason = reason
        self.end_streams()

    def restore(self) -> None:
        """End a cut."""
        with self._lock:
            self._down_until_ns = 0

    def why_down(self) -> str | None:
        """The reason for which calls are refused now; None while the link is up."""
        with self._lock:
            return self._reason if self.host_now_ns() < self._down_until_ns else None

    def end_streams(self, kind: str = "") -> int:
        """End the open streams of one kind (``state`` or ``command``), or all; returns how many."""
        with self._lock:
            chosen = [end for name, end in self._streams if kind in {"", name}]
        for end_stream in chosen:
            end_stream()
        return len(chosen)

    def open_streams(self, kind: str) -> int:
        """How many streams of one kind are open."""
        with self._lock:
            return sum(name == kind for name, _ in self._streams)

    def listen(self, kind: str, end_stream: Callable[[], None]) -> Callable[[], None]:
        """Have ``end_stream`` called when the stream has to end; returns what takes it off the list again."""
        entry = (kind, end_stream)
        with self._lock:
            self._streams.append(entry)

        def forget() -> None:
            with self._lock:
                if entry in self._streams:
                    self._streams.remove(entry)

        return forget


class GatekeeperInterceptor(grpc.ServerInterceptor):
    """Stands before every service of the robot.

    A call without a valid token is refused with UNAUTHENTICATED, but for the services that need none (auth, robot-id,
    payload-registration). Unary answers get their header: the request's header echoed, both times in robot time, and
    code OK unless the service set another.
    """

    def __init__(self, auth: AuthService, link: Link, robot_now_ns: Callable[[], int]) -> None:
        self._auth = auth
        self._link = link
        self._robot_now_ns = robot_now_ns

    def intercept_service(
        self,
        continuation: Callable[[grpc.HandlerCallDetails], grpc.RpcMethodHandler[Any, Any] | None],
        handler_call_details: grpc.HandlerCallDetails,
    ) -> grpc.RpcMethodHandler[Any, Any] | None:
        """Let the call through, or answer in the service's place."""
        handler = continuation(handler_call_details)
        if handler is None:
            return None
        method = handler_call_details.method
        refusal = self._refusal(method, handler_call_details)
        if refusal is not None:
            return _refusing(handler, *refusal)
        if handler.unary_unary is None:
            return handler
        return grpc.unary_unary_rpc_method_handler(
            self._with_header(handler.unary_unary), handler.request_deserializer, handler.response_serializer
        )

    def _refusal(self, method: str, details: grpc.HandlerCallDetails) -> tuple[grpc.StatusCode, str] | None:
        down = self._link.why_down()
        if down is not None:
            return grpc.StatusCode.UNAVAILABLE, down
        service = method.rpartition("/")[0].lstrip("/")
        if service in TOKENLESS_TYPES:
            return None
        if self._auth.user_of(_token_of(details.invocation_metadata)) is None:
            return (
                grpc.StatusCode.UNAUTHENTICATED,
                f"{service} needs a valid user token: authenticate first, or again (401)",
            )
        return None

    def _with_header(self, handler: Handler) -> Handler:
        def answer(request: Any, context: grpc.ServicerContext) -> Any:
            received_ns = self._robot_now_ns()
            response = handler(request, context)
            fill_header(response.header, request.header, received_ns, self._robot_now_ns())
            return response

        return answer


def fill_header(
    header: header_pb2.ResponseHeader, request: header_pb2.RequestHeader, received_ns: int, answered_ns: int
) -> None:
    """Echo the request's header and stamp the answer; code OK unless one is set. Times in robot nanoseconds."""
    header.request_header.CopyFrom(request)
    header.request_received_timestamp.CopyFrom(timestamp_from_ns(received_ns))
    header.response_timestamp.CopyFrom(timestamp_from_ns(answered_ns))
    if header.error.code == header_pb2.CommonError.CODE_UNSPECIFIED:
        header.error.code = header_pb2.CommonError.CODE_OK


def _token_of(metadata: Any) -> str:
    for key, value in metadata or ():
        if key == "authorization" and isinstance(value, str) and value.startswith(_BEARER):
            return value[len(_BEARER) :]
    return ""


def _refusing(
    handler: grpc.RpcMethodHandler[Any, Any], code: grpc.StatusCode, told: str
) -> grpc.RpcMethodHandler[Any, Any]:
    def refuse(_: object, context: grpc.ServicerContext) -> Any:
        context.abort(code, told)

    if handler.request_streaming and handler.response_streaming:
        return grpc.stream_stream_rpc_method_handler(refuse)
    if handler.request_streaming:
        return grpc.stream_unary_rpc_method_handler(refuse)
    if handler.response_streaming:
        return grpc.unary_stream_rpc_method_handler(refuse)
    return grpc.unary_unary_rpc_method_handler(refuse)
