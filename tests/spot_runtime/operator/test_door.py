"""The door by its parts: of a storm the newest connections are kept, and who has shown no role sends little."""

from __future__ import annotations

import asyncio
import socket
import threading

from spot_runtime.operator.door.acceptor import MAX_WAITING, Acceptor
from spot_runtime.operator.door.pipe import OF_NEWCOMERS, Pipe

TIMEOUT_S = 60.0


def test_of_a_storm_the_newest_connections_are_kept() -> None:
    listener = socket.create_server(("127.0.0.1", 0))
    woken: list[int] = []
    acceptor = Acceptor(listener, lambda: woken.append(1))
    clients: list[socket.socket] = []
    try:
        clients += [socket.create_connection(listener.getsockname(), TIMEOUT_S) for _ in range(MAX_WAITING + 10)]
        for given_up in clients[:10]:
            assert given_up.recv(1) == b""
        taken = acceptor.take()
        assert [one.getpeername() for one in taken] == [one.getsockname() for one in clients[10:]]
        assert woken == [1]
        for one in taken:
            one.close()
    finally:
        acceptor.close()
        for client in clients:
            client.close()


def test_a_storm_from_one_address_costs_no_other_its_place() -> None:
    listener = socket.create_server(("127.0.0.1", 0))
    woken = threading.Event()
    acceptor = Acceptor(listener, woken.set)
    clients: list[socket.socket] = []
    try:
        quiet = socket.create_connection(listener.getsockname(), TIMEOUT_S, ("127.0.0.2", 0))
        clients.append(quiet)
        clients += [socket.create_connection(listener.getsockname(), TIMEOUT_S) for _ in range(MAX_WAITING + 5)]
        assert clients[6].recv(1) == b""
        taken = acceptor.take()
        assert taken[0].getpeername() == quiet.getsockname()
        assert len(taken) == MAX_WAITING
        for one in taken:
            one.close()
    finally:
        acceptor.close()
        for client in clients:
            client.close()


def test_a_newcomer_sends_no_more_than_a_handshake_at_once() -> None:
    sent = 3 * OF_NEWCOMERS.burst_bytes

    async def passed() -> tuple[int, int]:
        loop = asyncio.get_running_loop()
        outer, source = socket.socketpair()
        target, inner = socket.socketpair()
        for one in (outer, source, target, inner):
            one.setblocking(False)
        pipe = Pipe(source, target, lambda: None, OF_NEWCOMERS)
        await loop.sock_sendall(outer, b"x" * sent)
        at_once = len(await loop.sock_recv(inner, sent))
        began_s, rest = loop.time(), 0
        pipe.widen()
        while at_once + rest < sent:
            rest += len(await loop.sock_recv(inner, sent))
        held_s = loop.time() - began_s
        pipe.close()
        for one in (outer, source, target, inner):
            one.close()
        assert held_s < TIMEOUT_S
        return at_once, rest

    at_once, rest = asyncio.run(asyncio.wait_for(passed(), TIMEOUT_S))
    assert at_once <= 2 * OF_NEWCOMERS.burst_bytes
    assert at_once + rest == sent
