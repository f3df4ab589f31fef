"""The live view's process: takes copies of log messages from a socket and serves them to Foxglove.

Arguments are the listening socket's descriptor and the TCP port. It ends when its standard input closes. Clients are
served by the SDK's own threads; one that reads slowly or not at all loses messages and delays no other.
"""

from __future__ import annotations

import selectors
import socket
import sys
import time
from typing import Final

import foxglove

from spot_log.format.codec import ALL_TOPICS, HEADER, SCENE
from spot_log.write.live_tap import HEAD, MAX_DATAGRAM_BYTES
from spot_log.write.logger_child import shed_inherited_settings

REPEAT_S: Final = 2.0
REPEATED: Final = (SCENE.channel_id, HEADER.channel_id)
"""Written once in a log, and repeated here for clients that connect later."""


class LiveView:
    """Channels like the log's, served."""

    def __init__(self, port: int) -> None:
        self._channels = {
            topic.channel_id: foxglove.Channel(
                topic.name,
                message_encoding="protobuf",
                schema=foxglove.Schema(name=topic.schema_name, encoding="protobuf", data=topic.schema_data()),
            )
            for topic in ALL_TOPICS
        }
        # Of a client's backlog, the oldest goes first.
        self._server = foxglove.start_server(name="spot-rl", host="127.0.0.1", port=port, message_backlog_size=256)
        self.port: int = self._server.port
        self._repeated: dict[int, bytes] = {}
        self._newest_ns = 0
        self._repeat_due_s = 0.0

    def take(self, datagram: bytes) -> None:
        """Show one message; malformed ones are skipped."""
        if len(datagram) < HEAD.size:
            return
        channel_id, log_ns = HEAD.unpack_from(datagram)
        channel = self._channels.get(channel_id)
        if channel is None:
            return
        data = datagram[HEAD.size :]
        self._newest_ns = max(self._newest_ns, log_ns)
        if channel_id in REPEATED:
            self._repeated[channel_id] = data
        channel.log(data, log_time=log_ns)

    def repeat(self) -> None:
        """Repeat what stands only at the start of a log."""
        now_s = time.monotonic()
        if now_s < self._repeat_due_s:
            return
        self._repeat_due_s = now_s + REPEAT_S
        for channel_id, data in self._repeated.items():
            self._channels[channel_id].log(data, log_time=self._newest_ns)

    def close(self) -> None:
        """Stop serving."""
        self._server.stop()


def serve_logs(view: LiveView, listener: socket.socket) -> None:
    """Take messages of one log after another until standard input closes."""
    listener.setblocking(False)
    with selectors.DefaultSelector() as selector:
        selector.register(sys.stdin.buffer, selectors.EVENT_READ)
        selector.register(listener, selectors.EVENT_READ)
        while True:
            for key, _ in selector.select(REPEAT_S):
                if key.fileobj is sys.stdin.buffer:
                    return
                if key.fileobj is listener:
                    connection, _address = listener.accept()
                    connection.setblocking(False)
                    selector.register(connection, selectors.EVENT_READ)
                elif isinstance(key.fileobj, socket.socket):
                    _drain(view, key.fileobj, selector)
            view.repeat()


def _drain(view: LiveView, connection: socket.socket, selector: selectors.BaseSelector) -> None:
    while True:
        try:
            datagram = connection.recv(MAX_DATAGRAM_BYTES)
        except BlockingIOError:
            return
        except OSError:
            datagram = b""
        if not datagram:
            selector.unregister(connection)
            connection.close()
            return
        view.take(datagram)


def main() -> None:
    """Run the process; its first line of output is the port, or why there is none."""
    shed_inherited_settings()
    foxglove.set_log_level("ERROR")
    listener = socket.socket(fileno=int(sys.argv[1]))
    try:
        view = LiveView(int(sys.argv[2]))
    except (RuntimeError, OSError) as error:
        sys.stdout.write(f"{error}\n")
        sys.stdout.flush()
        raise SystemExit(1) from None
    sys.stdout.write(f"{view.port}\n")
    sys.stdout.flush()
    try:
        serve_logs(view, listener)
    finally:
        view.close()


if __name__ == "__main__":
    main()
