"""Calls of our own services, made from their descriptors, in place of code generated for each."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from google.protobuf.message_factory import GetMessageClass


def stub(channel: Any, module: Any) -> Any:
    """The calls of the one service of a generated module, by name: ``stub(channel, operator_pb2).GetStatus(...)``."""
    (service,) = module.DESCRIPTOR.services_by_name.values()
    calls = {}
    for method in service.methods:
        make = channel.unary_stream if method.server_streaming else channel.unary_unary
        calls[method.name] = make(
            f"/{service.full_name}/{method.name}",
            request_serializer=GetMessageClass(method.input_type).SerializeToString,
            response_deserializer=GetMessageClass(method.output_type).FromString,
        )
    return SimpleNamespace(**calls)
