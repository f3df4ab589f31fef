"""The operator's service on the wire: limits, health and reflection."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

import grpc
from grpc_health.v1 import health, health_pb2, health_pb2_grpc
from grpc_reflection.v1alpha import reflection, reflection_pb2_grpc

from spot_protos import operator_pb2, operator_pb2_grpc
from spot_runtime.config import RunConfig
from spot_runtime.operator.listening import (
    ListenError,
    SocketFile,
    default_address,
    is_unix,
    server_credentials,
)
from spot_runtime.operator.refusal import Refusal
from spot_runtime.operator.server.access import Gate
from spot_runtime.operator.server.request_checks import MAX_MESSAGE_BYTES
from spot_runtime.operator.server.service import OperatorService
from spot_runtime.operator.server.supervisor import Supervisor

WORKERS: Final = 24
SERVICE_NAME: Final = operator_pb2.DESCRIPTOR.services_by_name["Operator"].full_name
OPTIONS: Final = (
    ("grpc.so_reuseport", 0),
    ("grpc.max_receive_message_length", MAX_MESSAGE_BYTES),
    ("grpc.max_metadata_size", 8 * 1024),
    ("grpc.max_concurrent_streams", 32),
    # A client whose computer has vanished is noticed, and its streams end.
    ("grpc.keepalive_time_ms", 10_000),
    ("grpc.keepalive_timeout_ms", 5_000),
    ("grpc.http2.min_ping_interval_without_data_ms", 5_000),
)


class OperatorServer:
    """Serves until it is closed."""

    def __init__(self, supervisor: Supervisor, config: RunConfig) -> None:
        """Listen and serve.

        Raises:
            BadInputError: The configuration does not say safely where and how.
            ListenError: The address is taken or cannot be used.
        """
        service_config = config.service
        wanted = service_config.listen or default_address(os.environ)
        credentials = server_credentials(service_config, wanted)
        gate = Gate(
            is_tls=credentials is not None,
            requests_per_s=service_config.requests_per_s,
            steering_per_s=service_config.steering_per_s,
        )
        self._service = OperatorService(supervisor, gate)
        self._socket = SocketFile(_path_of(wanted)) if is_unix(wanted) else None
        self._server = grpc.server(
            ThreadPoolExecutor(WORKERS, thread_name_prefix="operator"), options=OPTIONS, maximum_concurrent_rpcs=WORKERS
        )
        operator_pb2_grpc.add_OperatorServicer_to_server(self._service, self._server)  # type: ignore[no-untyped-call]
        self._health = health.HealthServicer()
        health_pb2_grpc.add_HealthServicer_to_server(self._health, self._server)
        reflection_pb2_grpc.add_ServerReflectionServicer_to_server(_Reflection(gate), self._server)  # type: ignore[no-untyped-call]
        try:
            self.address = self._bind(wanted, credentials)
        except BaseException:
            self._close_socket()
            raise
        self._server.start()
        for name in ("", SERVICE_NAME):
            self._health.set(name, health_pb2.HealthCheckResponse.SERVING)

    def close(self) -> None:
        """End every call, then stop serving."""
        self._service.is_closing = True
        self._health.enter_graceful_shutdown()
        self._server.stop(1.0).wait(5.0)
        self._close_socket()

    def _bind(self, wanted: str, credentials: grpc.ServerCredentials | None) -> str:
        try:
            if self._socket is not None:
                self._socket.bind(self._server)
                return wanted
            if credentials is not None:
                port = self._server.add_secure_port(wanted, credentials)
            else:
                port = self._server.add_insecure_port(wanted)
        except RuntimeError as error:
            raise ListenError(f"the service cannot listen on {wanted}: {error}; name another address") from error
        return f"{wanted.rpartition(':')[0]}:{port}"

    def _close_socket(self) -> None:
        if self._socket is not None:
            self._socket.close()


class _Reflection(reflection.ReflectionServicer):  # type: ignore[misc,unused-ignore]
    """One of the open streams: it holds a thread of the service as long as its client likes."""

    def __init__(self, gate: Gate) -> None:
        super().__init__((SERVICE_NAME, health.SERVICE_NAME, reflection.SERVICE_NAME))
        self._gate = gate

    def ServerReflectionInfo(self, request_iterator: Any, context: Any) -> Iterator[Any]:  # noqa: N802
        try:
            self._gate.open_stream("ServerReflectionInfo")
        except Refusal as refusal:
            context.abort(refusal.code, refusal.text)
        try:
            yield from super().ServerReflectionInfo(request_iterator, context)
        finally:
            self._gate.close_stream()


def _path_of(address: str) -> Path:
    return Path(address.removeprefix("unix:"))
