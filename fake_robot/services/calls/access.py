"""What every call passes on its way in and out: reachability, the token, the response header, errors in words."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import grpc
from bosdyn.api import header_pb2

from fake_robot.services.calls.link import Link
from fake_robot.services.calls.stamps import timestamp_from_ns
from fake_robot.services.identity.directory_entries import OWN_SERVICES, TOKENLESS_TYPES
from fake_robot.services.identity.tokens import TokenMint
from spot_model.errors import SpotRlError

_LOGGER = logging.getLogger(__name__)
_BEARER = "Bearer "
_OF_THE_TRANSPORT = ("grpc-", "user-agent", ":")

Handler = Callable[[Any, grpc.ServicerContext], Any]


class GatekeeperInterceptor(grpc.ServerInterceptor):
    """Stands before every service of the robot.

    A call without a valid token is refused with UNAUTHENTICATED, but for the services that need none (auth, robot-id,
    payload-registration). Unary answers get their header: the request's header echoed, both times in robot time, and
    code OK unless the service set another.
    """

    def __init__(self, tokens: TokenMint, link: Link, robot_now_ns: Callable[[], int]) -> None:
        self._tokens = tokens
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
            self._with_header(method, handler.unary_unary), handler.request_deserializer, handler.response_serializer
        )

    def _refusal(self, method: str, details: grpc.HandlerCallDetails) -> tuple[grpc.StatusCode, str] | None:
        down = self._link.why_down()
        if down is not None:
            return grpc.StatusCode.UNAVAILABLE, down
        service = method.rpartition("/")[0].lstrip("/")
        if service in TOKENLESS_TYPES:
            return None
        if self._tokens.user_of(_token_of(details.invocation_metadata)) is None:
            return (
                grpc.StatusCode.UNAUTHENTICATED,
                f"{service} needs a valid user token: authenticate first, or again (401)",
            )
        return None

    def _with_header(self, method: str, handler: Handler) -> Handler:
        def answer(request: Any, context: grpc.ServicerContext) -> Any:
            received_ns = self._robot_now_ns()
            try:
                response = handler(request, context)
            except SpotRlError as error:
                context.abort(grpc.StatusCode.INVALID_ARGUMENT, str(error))
            except grpc.RpcError:
                raise
            except Exception as error:
                _LOGGER.exception("%s failed", method)
                context.abort(grpc.StatusCode.INTERNAL, f"{method} failed in the fake robot: {type(error).__name__}")
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


def refuse_request(response: Any, message: str) -> Any:
    """Mark an answer as one to a request that makes no sense, whatever the robot's state; returns it."""
    response.header.error.code = header_pb2.CommonError.CODE_INVALID_REQUEST
    response.header.error.message = message
    return response


class UnknownServiceHandler(grpc.GenericRpcHandler):
    """Answers for every method that no service took: passes it on to a client's service of that type, or refuses it.

    Args:
        address_of_type: Host and port of the one service of a type that a client registered, or nothing.
    """

    def __init__(self, address_of_type: Callable[[str], str]) -> None:
        self._address_of_type = address_of_type

    def service(self, handler_call_details: grpc.HandlerCallDetails) -> grpc.RpcMethodHandler[Any, Any]:
        """Pass the call on, or refuse it with UNIMPLEMENTED, saying what there is."""
        service, _, method = handler_call_details.method.lstrip("/").rpartition("/")
        address = self._address_of_type(service)
        if address:
            return grpc.stream_stream_rpc_method_handler(_passing_on(handler_call_details, address))
        types = sorted({kind for kind, _, _ in OWN_SERVICES.values()})
        told = (
            f"{service} has no method {method!r}"
            if service in types
            else f"the fake robot has no service {service!r}; it has {', '.join(types)}"
        )

        def refuse(_: object, context: grpc.ServicerContext) -> Any:
            context.abort(grpc.StatusCode.UNIMPLEMENTED, told)

        return grpc.stream_stream_rpc_method_handler(refuse)


def _passing_on(details: grpc.HandlerCallDetails, address: str) -> Handler:
    """Pass the bytes of a call on to a server without TLS, as a robot does, and its answers back."""
    metadata = tuple((k, v) for k, v in details.invocation_metadata or () if not k.startswith(_OF_THE_TRANSPORT))

    def pass_on(requests: Any, context: grpc.ServicerContext) -> Any:
        with grpc.insecure_channel(address) as channel:
            call: Any = channel.stream_stream(details.method)
            answers = call(requests, metadata=metadata, timeout=context.time_remaining())
            context.add_callback(answers.cancel)
            try:
                yield from answers
            except grpc.RpcError as refusal:
                told: Any = refusal
                context.abort(told.code(), f"{address}, a registered service: {told.details()}")

    return pass_on


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
