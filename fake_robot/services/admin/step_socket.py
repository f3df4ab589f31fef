"""Steps without gRPC, for a client that takes fifty a second: a request and its answer are one datagram each."""

from __future__ import annotations

import socket
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path

from google.protobuf.message import DecodeError

from fake_robot.services.admin.stepping import StepRefusedError
from spot_protos import fake_admin_pb2

MAX_REQUEST_BYTES = 65536
SEND_BUFFER_BYTES = 1 << 20
"""An answer has to fit: 800 bytes a state."""


class StepSocket:
    """Listens on a socket in a private folder until it is closed."""

    def __init__(self, step: Callable[[fake_admin_pb2.StepRequest], fake_admin_pb2.StepResponse]) -> None:
        """Listen; ``step`` is called from one thread a client."""
        self._step = step
        self._folder = tempfile.TemporaryDirectory(prefix="spot-rl-steps-")
        self.path = str(Path(self._folder.name) / "socket")
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._listener.bind(self.path)
        self._listener.listen()
        threading.Thread(target=self._accept, name="step-socket", daemon=True).start()

    def close(self) -> None:
        """Take no more clients."""
        self._listener.shutdown(socket.SHUT_RDWR)  # which also ends the wait for the next client
        self._listener.close()
        self._folder.cleanup()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=(client,), name="steps", daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        with client:
            client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
            try:
                while datagram := client.recv(MAX_REQUEST_BYTES):
                    client.send(self._answer(datagram).SerializeToString())
            except OSError:
                return  # the client is gone

    def _answer(self, datagram: bytes) -> fake_admin_pb2.StepResponse:
        try:
            return self._step(fake_admin_pb2.StepRequest.FromString(datagram))
        except (StepRefusedError, DecodeError) as error:
            return fake_admin_pb2.StepResponse(refusal=str(error))
