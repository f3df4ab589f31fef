"""The live view's end in the logger process: a socket that never blocks.

The loop does not know of the live view at all. The log's process, which has every message in the form that viewers
read, sends a copy to the live view's process; what does not fit into the socket is dropped and counted. States and
commands are thinned to 50 a second: enough for a screen.
"""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Mapping
from typing import Final

from spot_log.format.codec import COMMAND, STATE
from spot_log.format.viewer import VIEWER_PERIOD_NS

SOCKET_VARIABLE: Final = "SPOT_RL_LIVE_SOCKET"
HEAD: Final = struct.Struct("<Hq")
"""Channel's number, log time in ns; the message's bytes follow."""

MAX_DATAGRAM_BYTES: Final = 192 * 1024
SEND_BUFFER_BYTES: Final = 1 << 20
_THINNED: Final = (STATE.channel_id, COMMAND.channel_id)


class LiveTap:
    """Sends copies of log messages to the live view, as long as it takes them."""

    def __init__(self, connection: socket.socket | None) -> None:
        """Send to this socket, if there is one."""
        self._socket = connection
        self._slots: dict[int, int] = {}
        self.dropped = 0
        """Messages that the live view did not take."""

    @staticmethod
    def from_environment(environment: Mapping[str, str] = os.environ) -> LiveTap:
        """Connect to the live view that the environment names; None if it is not there."""
        path = environment.get(SOCKET_VARIABLE, "")
        if not path:
            return LiveTap(None)
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_CLOEXEC)
        connection.setblocking(False)
        try:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
            connection.connect(path)
        except OSError:
            connection.close()
            return LiveTap(None)
        return LiveTap(connection)

    def put(self, channel_id: int, data: bytes, log_ns: int) -> None:
        """Send a copy of one message; never waits, never raises."""
        if self._socket is None:
            return
        if channel_id in _THINNED:
            slot = log_ns // VIEWER_PERIOD_NS
            if self._slots.get(channel_id) == slot:
                return
            self._slots[channel_id] = slot
        try:
            self._socket.send(HEAD.pack(channel_id, log_ns) + data, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except (BlockingIOError, InterruptedError):
            self.dropped += 1
        except OSError:
            self.close()

    def close(self) -> None:
        """Send nothing more."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
