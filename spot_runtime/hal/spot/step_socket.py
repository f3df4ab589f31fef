"""Steps of a fake robot in lock-step: a request leaves at once, and its answer is taken later."""

from __future__ import annotations

import socket
from typing import Final

from spot_protos import fake_admin_pb2

ANSWER_TIMEOUT_S: Final = 10.0
"""Host time within which a step must be done."""

MAX_ANSWER_BYTES: Final = 1 << 18


class StepSocket:
    """One step at a time, a datagram each way. Methods raise ``OSError`` where the fake robot is gone or hangs."""

    def __init__(self, path: str) -> None:
        """Connect to the socket that the admin service tells."""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.settimeout(ANSWER_TIMEOUT_S)
        try:
            self._socket.connect(path)
        except BaseException:
            self._socket.close()
            raise

    def ask(self, request: fake_admin_pb2.StepRequest) -> None:
        """Begin a step."""
        self._socket.send(request.SerializeToString())

    def answer(self) -> fake_admin_pb2.StepResponse:
        """Wait for the end of the step that was asked for."""
        datagram = self._socket.recv(MAX_ANSWER_BYTES)
        if not datagram:
            raise ConnectionResetError("it ended")
        return fake_admin_pb2.StepResponse.FromString(datagram)

    def close(self) -> None:
        """End it."""
        self._socket.close()
