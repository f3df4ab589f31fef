"""What a service is: a memory, and methods that fill in the answers to requests; with the times on the wire."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager
from typing import Any, ClassVar, TypeAlias

import grpc
from bosdyn.api import header_pb2
from google.protobuf import message_factory
from google.protobuf.duration_pb2 import Duration
from google.protobuf.timestamp_pb2 import Timestamp

from spot_model.errors import SpotRlError
from spot_model.robot.facts import NS_PER_S

Answer: TypeAlias = Callable[[Any, Any], None]
"""Gets a request and a fresh response, and fills the response in."""
_LOGGER = logging.getLogger(__name__)


class RefusedCallError(SpotRlError):
    """A call that ends with a gRPC status instead of an answer."""

    def __init__(self, code: grpc.StatusCode, message: str) -> None:
        super().__init__(message)
        self.code = code


class Service:
    """The memory of a service, or of several that share one, and its answers.

    An answer is a method under the vendor's name for it, or an entry of ``table``. Answers are given one at a time;
    whoever else reads or changes the memory holds ``lock``.
    """

    modules: ClassVar[tuple[Any, ...]]
    """The vendor's modules of the services for which it answers."""
    table: ClassVar[Mapping[str, Answer]] = {}
    """By the method's name."""

    lock: AbstractContextManager[Any]

    def __init__(self) -> None:
        self.lock = threading.RLock()

    def answer(self, method: Any, request: Any, context: grpc.ServicerContext) -> Any:
        """The response to one request; an error ends the call, in words."""
        response = message_factory.GetMessageClass(method.output_type)()
        answer = self.table.get(method.name) or getattr(self, method.name)
        try:
            with self.lock:
                answer(request, response)
        except SpotRlError as error:
            code = error.code if isinstance(error, RefusedCallError) else grpc.StatusCode.INVALID_ARGUMENT
            context.abort(code, str(error))
        except Exception as error:
            _LOGGER.exception("%s failed", method.full_name)
            told = f"{method.full_name} failed in the fake robot: {type(error).__name__}"
            context.abort(grpc.StatusCode.INTERNAL, told)
        return response


class UnaryCalls(grpc.GenericRpcHandler):
    """Serves the answers of services; a method that none answers is left to the next handler.

    With the robot's clock, answers get their header: the request's echoed, both times, and code OK unless the service
    set another.
    """

    def __init__(self, services: Iterable[Service], robot_now_ns: Callable[[], int] | None = None) -> None:
        self._robot_now_ns = robot_now_ns
        self._handlers = {
            f"/{kind.full_name}/{method.name}": self._handler(service, method)
            for service in services
            for module in service.modules
            for kind in module.DESCRIPTOR.services_by_name.values()
            for method in kind.methods
            if method.name in service.table or hasattr(service, method.name)
        }

    def service(self, handler_call_details: grpc.HandlerCallDetails) -> grpc.RpcMethodHandler[Any, Any] | None:
        """The handler of a method."""
        return self._handlers.get(handler_call_details.method)

    def _handler(self, service: Service, method: Any) -> grpc.RpcMethodHandler[Any, Any]:
        now_ns = self._robot_now_ns

        def respond(request: Any, context: grpc.ServicerContext) -> Any:
            if now_ns is None:
                return service.answer(method, request, context)
            received_ns = now_ns()
            response = service.answer(method, request, context)
            fill_header(response.header, request.header, received_ns, now_ns())
            return response

        return grpc.unary_unary_rpc_method_handler(
            respond,
            request_deserializer=message_factory.GetMessageClass(method.input_type).FromString,
            response_serializer=message_factory.GetMessageClass(method.output_type).SerializeToString,
        )


def fill_header(
    header: header_pb2.ResponseHeader, request: header_pb2.RequestHeader, received_ns: int, answered_ns: int
) -> None:
    """Echo the request's header and stamp the answer; code OK unless one is set. Times in robot nanoseconds."""
    header.request_header.CopyFrom(request)
    header.request_received_timestamp.CopyFrom(timestamp_from_ns(received_ns))
    header.response_timestamp.CopyFrom(timestamp_from_ns(answered_ns))
    if header.error.code == header_pb2.CommonError.CODE_UNSPECIFIED:
        header.error.code = header_pb2.CommonError.CODE_OK


def refusing(code: grpc.StatusCode, message: str) -> grpc.RpcMethodHandler[Any, Any]:
    """A handler that ends every call, whatever streams it has."""

    def refuse_call(_: object, context: grpc.ServicerContext) -> Any:
        context.abort(code, message)

    return grpc.stream_stream_rpc_method_handler(refuse_call)


def refuse(response: Any, message: str) -> None:
    """Mark an answer as one to a request that makes no sense, whatever the robot's state."""
    response.header.error.code = header_pb2.CommonError.CODE_INVALID_REQUEST
    response.header.error.message = message


def timestamp_from_ns(stamp_ns: int) -> Timestamp:
    """A timestamp of ``stamp_ns`` nanoseconds since the UNIX epoch."""
    return Timestamp(seconds=stamp_ns // NS_PER_S, nanos=stamp_ns % NS_PER_S)


def duration_from_ns(duration_ns: int) -> Duration:
    """A duration whose seconds and nanoseconds have one sign, as protobuf demands."""
    seconds, nanos = divmod(abs(duration_ns), NS_PER_S)
    return Duration(seconds=seconds, nanos=nanos) if duration_ns >= 0 else Duration(seconds=-seconds, nanos=-nanos)


def ns_of(time: Timestamp | Duration) -> int:
    """Nanoseconds since the UNIX epoch, or of a duration with its sign; whatever a client managed to send."""
    return time.seconds * NS_PER_S + time.nanos
