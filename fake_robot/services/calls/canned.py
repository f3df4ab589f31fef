"""Services whose answers are a table: method name to a function that fills in the response."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeAlias

import grpc
from google.protobuf import descriptor_pool, message_factory


class Call(NamedTuple):
    """One call of a service in a table."""

    world: Any
    request: Any
    response: Any
    """Fresh; the answer fills it in."""


Answer: TypeAlias = Callable[[Call], None]


class CannedServices(grpc.GenericRpcHandler):
    """Serves the unary methods of a table; a method that is not in it is left to the next handler.

    Args:
        answers: By full service name, then by method name.
        world: Handed to every answer.
    """

    def __init__(self, answers: Mapping[str, Mapping[str, Answer]], world: object) -> None:
        self._handlers: dict[str, grpc.RpcMethodHandler[Any, Any]] = {}
        for service_name, methods in answers.items():
            service = descriptor_pool.Default().FindServiceByName(service_name)
            for name, answer in methods.items():
                method = service.methods_by_name[name]
                self._handlers[f"/{service_name}/{name}"] = _handler(method, answer, world)

    def service(self, handler_call_details: grpc.HandlerCallDetails) -> grpc.RpcMethodHandler[Any, Any] | None:
        """The handler of a method in the table."""
        return self._handlers.get(handler_call_details.method)


def _handler(method: Any, answer: Answer, world: object) -> grpc.RpcMethodHandler[Any, Any]:
    request_type = message_factory.GetMessageClass(method.input_type)
    response_type = message_factory.GetMessageClass(method.output_type)

    def respond(request: Any, _context: grpc.ServicerContext) -> Any:
        response = response_type()
        answer(Call(world, request, response))
        return response

    return grpc.unary_unary_rpc_method_handler(
        respond,
        request_deserializer=request_type.FromString,
        response_serializer=response_type.SerializeToString,
    )
