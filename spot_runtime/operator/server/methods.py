"""The proto's methods as gRPC handlers: which role each needs, which threads carry it out, and what does the work."""

from __future__ import annotations

import re
from collections.abc import AsyncIterator, Callable
from typing import Any, Final

import grpc
from google.protobuf.message_factory import GetMessageClass

from spot_protos import operator_pb2
from spot_runtime.operator.door.access import Lane
from spot_runtime.operator.door.callers import Role
from spot_runtime.operator.door.guard import Guard, Rule
from spot_runtime.operator.door.lanes import Lanes
from spot_runtime.operator.server.service import OperatorService

DESCRIPTOR: Final = operator_pb2.DESCRIPTOR.services_by_name["Operator"]
SERVICE_NAME: Final = DESCRIPTOR.full_name
_RULES: Final = {
    "GetStatus": Rule("status"),
    "WatchStatus": Rule("watch"),
    "ListModes": Rule("modes"),
    "ListPolicies": Rule("policies"),
    "StreamEvents": Rule("events"),
    "Arm": Rule("arm", Role.OPERATE),
    "Start": Rule("start", Role.OPERATE),
    "Stop": Rule("stop", Role.OBSERVE, Lane.STOP),
    "Damp": Rule("damp", Role.OBSERVE, Lane.DAMP),
    "SetVelocity": Rule("velocity", Role.OPERATE, Lane.STEER),
    "SwitchPolicy": Rule("switch-policy", Role.OPERATE),
    "StartLog": Rule("start-log", Role.OPERATE),
    "LabelLog": Rule("label-log", Role.OPERATE),
    "Attend": Rule("attend", Role.OPERATE, Lane.ATTEND),
}
RULES: Final = {f"/{SERVICE_NAME}/{name}": rule for name, rule in _RULES.items()}


def work_of(service: OperatorService, name: str) -> Callable[..., Any]:
    """What does the work of a method of the proto: the one of the same name in Python's spelling."""
    work: Callable[..., Any] = getattr(service, re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower())
    return work


def handlers(service: OperatorService, guard: Guard, lanes: Lanes) -> grpc.GenericRpcHandler:
    """All methods, for a server of ``grpc.aio``."""
    made: dict[str, grpc.RpcMethodHandler[Any, Any]] = {}
    for method in DESCRIPTOR.methods:
        work = work_of(service, method.name)
        codecs = (GetMessageClass(method.input_type).FromString, GetMessageClass(method.output_type).SerializeToString)
        if method.name in ("WatchStatus", "StreamEvents"):
            made[method.name] = grpc.unary_stream_rpc_method_handler(_streamed(work, guard), *codecs)
        else:
            lane = _RULES[method.name].lane
            made[method.name] = grpc.unary_unary_rpc_method_handler(_answered(work, guard, lanes, lane), *codecs)
    return grpc.method_handlers_generic_handler(SERVICE_NAME, made)


def _answered(work: Callable[..., Any], guard: Guard, lanes: Lanes, lane: Lane) -> Callable[..., Any]:
    async def answer(request: Any, context: Any) -> Any:
        return await lanes.run(lane, work, request, guard.caller(context))

    return answer


def _streamed(work: Callable[..., Any], guard: Guard) -> Callable[..., Any]:
    async def stream(request: Any, context: Any) -> AsyncIterator[Any]:
        async for message in work(request, guard.caller(context)):
            yield message

    return stream
