"""A client of Foxglove's WebSocket protocol, for tests."""

from __future__ import annotations

import contextlib
import json
import struct
from collections.abc import Iterator
from typing import Any

from websockets.sync.client import connect

TIMEOUT_S = 120.0


class Viewer:
    """A client like Foxglove: subscribes to all channels that are advertised."""

    def __init__(self, url: str) -> None:
        connection = connect(url, subprotocols=["foxglove.sdk.v1"], max_size=None)  # type: ignore[list-item]
        self._open = contextlib.ExitStack()
        self.socket = self._open.enter_context(connection)
        self.channels: dict[int, dict[str, Any]] = {}
        while not self.channels:
            message = self.socket.recv(TIMEOUT_S)
            if isinstance(message, str) and json.loads(message)["op"] == "advertise":
                self.channels = {c["id"]: c for c in json.loads(message)["channels"]}
        wanted = [{"id": number, "channelId": number} for number in self.channels]
        self.socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def close(self) -> None:
        self._open.close()

    def messages(self) -> Iterator[tuple[str, int, bytes]]:
        """Topic, log time and bytes, as they come."""
        while True:
            message = self.socket.recv(TIMEOUT_S)
            if isinstance(message, bytes) and message[0] == 1:
                number, stamp_ns = struct.unpack_from("<IQ", message, 1)
                yield self.channels[number]["topic"], stamp_ns, message[13:]
