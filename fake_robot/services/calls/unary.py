"""Unary services without generated servicers: objects whose methods answer, and tables of functions that do."""

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


class UnaryServices(grpc.GenericRpcHandler):
    """Serves the methods of objects and of a table; a method of neither is left to the next handler.

    Args:
        services: By full service name, an object with methods named as the vendor's, from request to response.
        answers: By full service name, then by method name.
        world: Handed to every answer.
    """

    def __init__(
        self, services: Mapping[str, object], answers: Mapping[str, Mapping[str, Answer]], world: object
    ) -> None:
        self._handlers: dict[str, grpc.RpcMethodHandler[Any, Any]] = {}
        for service_name, service in services.items():
            for method in _methods(service_name):
                if hasattr(service, method.name):
                    self._add(method, getattr(service, method.name))
        for service_name, by_name in answers.items():
            methods = {method.name: method for method in _methods(service_name)}
            for name, answer in by_name.items():
                self._add(methods[name], _filled_in(methods[name], answer, world))

    def service(self, handler_call_details: grpc.HandlerCallDetails) -> grpc.RpcMethodHandler[Any, Any] | None:
        """The handler of a method."""
        return self._handlers.get(handler_call_details.method)

    def _add(self, method: Any, respond: Callable[[Any], Any]) -> None:
        self._handlers[f"/{method.containing_service.full_name}/{method.name}"] = grpc.unary_unary_rpc_method_handler(
            lambda request, _context: respond(request),
            request_deserializer=message_factory.GetMessageClass(method.input_type).FromString,
            response_serializer=message_factory.GetMessageClass(method.output_type).SerializeToString,
        )


def _methods(service_name: str) -> Any:
    return descriptor_pool.Default().FindServiceByName(service_name).methods


def _filled_in(method: Any, answer: Answer, world: object) -> Callable[[Any], Any]:
    response_type = message_factory.GetMessageClass(method.output_type)

    def respond(request: Any) -> Any:
        response = response_type()
        answer(Call(world, request, response))
        return response

    return respond
