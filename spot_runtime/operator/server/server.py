"""The operator's service on the wire: the proto's methods behind the door, health and reflection, in one event loop."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import socket
import ssl
import threading
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import Any, Final, TypeVar

import grpc
from google.protobuf.message_factory import GetMessageClass
from grpc import aio
from grpc_health.v1 import health, health_pb2, health_pb2_grpc
from grpc_reflection.v1alpha import reflection

from spot_model.process.private_folder import make_private_folder
from spot_protos import operator_pb2
from spot_runtime.config import RunConfig
from spot_runtime.operator.door.access import Gate, Lane, Lanes
from spot_runtime.operator.door.callers import Role
from spot_runtime.operator.door.door import Door
from spot_runtime.operator.door.guard import Guard, Rule
from spot_runtime.operator.listening import Listener, default_address, server_tls
from spot_runtime.operator.server.service import MAX_MESSAGE_BYTES, OperatorService
from spot_runtime.operator.server.supervisor import Supervisor

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


FOLDER_PREFIX: Final = "spot-rl-door-"
INNER_NAME: Final = "grpc.sock"
START_TIMEOUT_S: Final = 20.0
MAX_STREAMS: Final = 32
OPTIONS: Final = (
    ("grpc.so_reuseport", 0),
    ("grpc.max_receive_message_length", MAX_MESSAGE_BYTES),
    ("grpc.max_metadata_size", 8 * 1024),
    ("grpc.max_concurrent_streams", MAX_STREAMS),
    # A client whose computer has vanished is noticed, and its streams end.
    ("grpc.keepalive_time_ms", 10_000),
    ("grpc.keepalive_timeout_ms", 5_000),
    ("grpc.http2.min_ping_interval_without_data_ms", 5_000),
)
Answer = TypeVar("Answer")


class OperatorServer:
    """Serves until it is closed."""

    def __init__(self, supervisor: Supervisor, config: RunConfig) -> None:
        """Listen and serve.

        Raises:
            BadInputError: The configuration does not say safely where and how.
            ListenError: The address is taken or cannot be used.
        """
        wanted = config.service.listen or default_address(os.environ)
        tls = server_tls(config.service, wanted)
        self._listener = Listener(wanted)
        self.address = self._listener.address
        self._folder = make_private_folder(os.environ, FOLDER_PREFIX, INNER_NAME, socket.SOCK_STREAM)
        gate = Gate(requests_per_s=config.service.requests_per_s, steering_per_s=config.service.steering_per_s)
        self._guard = Guard(gate, RULES)
        self._lanes, self._service = Lanes(), OperatorService(supervisor, gate)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="operator", daemon=True)
        self._thread.start()
        try:
            self._call(self._start(tls))
        except BaseException:
            self._clear_up()
            raise

    def close(self) -> None:
        """End every call, then stop serving."""
        self._call(self._stop())
        self._clear_up()

    async def _start(self, tls: ssl.SSLContext | None) -> None:
        server = self._server = aio.server(interceptors=[self._guard], options=OPTIONS)
        server.add_generic_rpc_handlers((handlers(self._service, self._guard, self._lanes),))
        self._health = health.aio.HealthServicer()
        health_pb2_grpc.add_HealthServicer_to_server(self._health, server)
        reflection.enable_server_reflection((SERVICE_NAME, health.SERVICE_NAME, reflection.SERVICE_NAME), server)
        inner = self._folder / INNER_NAME
        server.add_insecure_port(f"unix:{inner}")
        await server.start()
        await self._health.set(SERVICE_NAME, health_pb2.HealthCheckResponse.SERVING)
        self._door = self._guard.door = Door(self._listener.socket, inner, tls)

    async def _stop(self) -> None:
        await self._health.enter_graceful_shutdown()
        await self._server.stop(0.5)
        self._door.close()

    def _call(self, work: Coroutine[Any, Any, Answer]) -> Answer:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(START_TIMEOUT_S)

    def _clear_up(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(START_TIMEOUT_S)
        if not self._thread.is_alive():
            self._loop.close()
        self._lanes.close()
        self._listener.close()
        shutil.rmtree(self._folder, ignore_errors=True)
