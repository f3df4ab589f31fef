"""A server that passes every call on to a fake robot, with one error of ``errors`` at a time."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent import futures
from typing import Any, Self

import grpc
from google.protobuf import descriptor_pool, message_factory

from fake_robot.start.certificates import ServerCertificates
from proof.planted.planting import ANY, PlantedError

RIGHT = PlantedError("right", "Nothing is wrong.", "own", needs_motion=False)
_THREADS = 48
_BY_TRANSPORT = ("grpc-", "user-agent", ":")


class PlantedServer(grpc.GenericRpcHandler):
    """A TLS server on a port of its own in front of the robot at ``target``. A context manager."""

    def __init__(self, target: str, certificates: ServerCertificates) -> None:
        trusted = grpc.ssl_channel_credentials(certificates.ca_path.read_bytes())
        options = [("grpc.ssl_target_name_override", "api.spot.robot")]
        self._channel = grpc.secure_channel(target, trusted, options)
        self._server = grpc.server(futures.ThreadPoolExecutor(_THREADS), options=[("grpc.so_reuseport", 0)])
        self._server.add_generic_rpc_handlers((self,))
        key = [(certificates.key_pem, certificates.certificate_pem)]
        self.port = self._server.add_secure_port("127.0.0.1:0", grpc.ssl_server_credentials(key))
        self.address = f"127.0.0.1:{self.port}"
        self._lock = threading.Lock()
        self.plant(RIGHT)

    def plant(self, error: PlantedError) -> None:
        """Replace the error, and forget what was remembered and asked."""
        self._error, self.memory = error, dict[str, Any]()
        self.asked: list[tuple[str, Any]] = []
        self._token = ""

    def __enter__(self) -> Self:
        self._server.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.stop(0.2).wait()
        self._channel.close()

    def service(self, handler_call_details: grpc.HandlerCallDetails) -> grpc.RpcMethodHandler[Any, Any]:
        """Any method is a stream of bytes each way."""
        method, given = handler_call_details.method, handler_call_details.invocation_metadata
        metadata = [(key, value) for key, value in given if not key.startswith(_BY_TRANSPORT)]

        def forward(requests: Iterator[bytes], context: grpc.ServicerContext) -> Iterator[bytes]:
            return self._forward(method, metadata, requests, context)

        return grpc.stream_stream_rpc_method_handler(forward)

    def _forward(
        self, method: str, metadata: list[tuple[str, Any]], requests: Iterator[bytes], context: grpc.ServicerContext
    ) -> Iterator[bytes]:
        service, _, name = method.strip("/").rpartition("/")
        key = f"{service.rpartition('.')[2]}/{name}"
        try:
            found = descriptor_pool.Default().FindServiceByName(service).methods_by_name[name]
            types: Any = [message_factory.GetMessageClass(kind) for kind in (found.input_type, found.output_type)]
        except KeyError:
            types = [None, None]
        request_type, answer_type = types
        error = self._error
        ask = error.asks.get(key)
        answer = error.answers.get(key) or (error.answers.get(ANY) if answer_type is not None else None)
        last: list[Any] = []

        def asked() -> Iterator[bytes]:
            for raw in requests:
                if request_type is None:
                    yield raw
                    continue
                request = request_type.FromString(raw)
                last[:] = [request]
                self.asked.append((key, request_type.FromString(raw)))
                if ask is None:
                    yield raw
                    continue
                with self._lock:
                    ask(request, None, self.memory)
                yield request.SerializeToString()

        stub: Any = self._channel.stream_stream(method)
        call = stub(asked(), metadata=self._with_token(metadata))
        context.add_callback(call.cancel)
        try:
            for raw in call:
                if answer is None:
                    yield raw
                    continue
                message = answer_type.FromString(raw)
                with self._lock:
                    instead = answer(last[0] if last else None, message, self.memory)
                for sent in [message] if instead is None else instead:
                    yield sent.SerializeToString()
        except grpc.RpcError as refusal:
            context.abort(refusal.code(), refusal.details() or "")

    def _with_token(self, metadata: list[tuple[str, Any]]) -> list[tuple[str, Any]]:
        """The call's own metadata; those of a server that needs no token, with the last one that it saw."""
        given = str(dict(metadata).get("authorization", ""))
        self._token = max(self._token, given, key=len)
        if self._error.name != "no_token_needed":
            return metadata
        return [*((key, value) for key, value in metadata if key != "authorization"), ("authorization", self._token)]
