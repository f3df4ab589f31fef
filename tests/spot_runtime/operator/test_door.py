"""The door by its parts: what passes in a turn, whose turn it is, and who makes room for whom."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from proof.attacks.certificates import LOOPBACK, Authority, role
from proof.attacks.target import serve
from proof.attacks.wire import DATA, END_HEADERS, HEADERS, PING, PREFACE, SETTINGS, connect, frame, head_of_call
from spot_runtime.operator.door import connection
from spot_runtime.operator.door.connection import MOST_FRAMES, Frames
from spot_runtime.operator.door.door import MAX_ADMITTED, MAX_NEWCOMERS
from spot_runtime.operator.door.turns import Place, Turns

TIMEOUT_S = 60.0

# Frames ---------------------------------------------------------------------------------------------------------------

kinds = st.sampled_from([DATA, HEADERS, SETTINGS, PING])
streams_of_frames = st.lists(st.tuples(kinds, st.binary(max_size=40)), max_size=80)


@given(streams_of_frames, st.lists(st.integers(1, 60), min_size=1), st.booleans())
def test_cuts_lose_nothing_and_hold_one_call_at_most(
    sent: list[tuple[int, bytes]], sizes: list[int], may_call: bool
) -> None:
    whole = PREFACE + b"".join(frame(kind, 0, 1, body) for kind, body in sent)
    frames, held, passed, at, calls = Frames(), bytearray(), bytearray(), 0, 0
    for size in [*sizes, *[len(whole)] * (len(sent) + 2)]:
        held += whole[at : at + size]
        at = min(len(whole), at + size)
        cut, has_call = frames.cut(held, may_call=may_call)
        part = bytes(held[:cut])
        del held[:cut]
        passed += part
        calls += has_call
        assert not frames.is_at_call or held[3] == HEADERS
    heads = sum(kind == HEADERS for kind, _ in sent)
    if may_call:
        assert bytes(passed) == whole[: len(passed)]
        assert (bytes(passed) == whole, calls) == (True, heads)
    else:
        assert calls == 0
        assert bytes(passed + held) == whole
        assert bool(held) == bool(heads)


def test_a_turn_passes_so_many_frames_and_no_more() -> None:
    pings = frame(PING, 0, 0, bytes(8)) * 1000
    frames = Frames()
    cut, _ = frames.cut(PREFACE + pings, may_call=True)
    assert cut <= len(PREFACE) + MOST_FRAMES * 17


# Turns ----------------------------------------------------------------------------------------------------------------


class Asking:
    """Asks for turns as often as it is told."""

    def __init__(self, name: str, order: list[str], *, has_role: bool = True, peer: str = "", times: int = 1) -> None:
        self.name, self.order, self.times = name, order, times
        self.place = Place(has_role, peer or name)
        self.turns: Turns | None = None

    def turn(self) -> None:
        self.order.append(self.name)
        self.times -= 1
        if self.times and self.turns is not None:
            self.turns.ask(self.turn, self.place)


def granted(*askers: Asking) -> None:
    async def run() -> None:
        turns = Turns()
        for asker in askers:
            asker.turns = turns
            turns.ask(asker.turn, asker.place)
            turns.ask(asker.turn, asker.place)  # counts once
        for _ in range(sum(asker.times for asker in askers) + 3):
            await asyncio.sleep(0)
        turns.close()

    asyncio.run(run())


def test_a_flood_waits_behind_every_other_peer() -> None:
    order: list[str] = []
    flood = [Asking("flood", order, times=5) for _ in range(6)]
    granted(*flood, Asking("one", order), Asking("two", order))
    assert order[:4] == ["flood", "one", "two", "flood"]
    assert len(order) == 32


def test_newcomers_and_those_with_a_role_alternate() -> None:
    order: list[str] = []
    newcomers = [Asking("newcomer", order, has_role=False, peer=str(number)) for number in range(5)]
    granted(*newcomers, *(Asking("known", order, peer=str(number)) for number in range(2)))
    assert order == ["known", "newcomer", "known", *["newcomer"] * 4] or order == [
        *["newcomer", "known"] * 2,
        *["newcomer"] * 3,
    ]


def test_whoever_withdraws_has_no_turn() -> None:
    order: list[str] = []

    async def run() -> None:
        turns, gone, other = Turns(), Asking("gone", order), Asking("other", order)
        turns.ask(gone.turn, gone.place)
        turns.ask(other.turn, other.place)
        assert turns.withdraw(gone.turn)
        assert not turns.withdraw(gone.turn)
        for _ in range(4):
            await asyncio.sleep(0)

    asyncio.run(run())
    assert order == ["other"]


# Over sockets ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def tls(tmp_path: Path) -> Iterator[tuple[str, Authority]]:
    authority = Authority(tmp_path, "authority")
    certificate, key = authority.sign("robot", LOOPBACK)
    files = {"tls_certificate": str(certificate), "tls_key": str(key), "tls_client_ca": str(authority.file)}
    server, _ = serve("127.0.0.1:0", **files)
    yield server.address, authority
    server.close()


def test_half_a_handshake_does_not_make_room_for_none(tls: tuple[str, Authority]) -> None:
    """All of them have the same address. The oldest of those that said nothing give way."""
    address, authority = tls
    context = ssl.create_default_context(cafile=str(authority.file))
    context.load_cert_chain(*authority.sign("otto", role("observe")))
    context.set_alpn_protocols(["h2"])
    told, heard = ssl.MemoryBIO(), ssl.MemoryBIO()
    client = context.wrap_bio(heard, told, server_hostname="127.0.0.1")
    with connect(address, timeout_s=TIMEOUT_S) as half:
        with pytest.raises(ssl.SSLWantReadError):
            client.do_handshake()
        half.sendall(told.read())
        heard.write(half.recv(65536))
        silent = [connect(address, timeout_s=TIMEOUT_S) for _ in range(MAX_NEWCOMERS + 20)]
        assert silent[0].recv(1) == b""
        while True:
            try:
                client.do_handshake()
                break
            except ssl.SSLWantReadError:
                heard.write(half.recv(65536))
        client.write(PREFACE + frame(SETTINGS, 0, 0))
        half.sendall(told.read())
        heard.write(half.recv(65536))
        assert client.read(9)[3] == SETTINGS
        for one in silent:
            one.close()


def test_a_certificate_without_a_role_takes_no_place_of_those_with_one(tls: tuple[str, Authority]) -> None:
    address, authority = tls
    pairs = [
        (authority.file, *authority.sign(name, *names)) for name, names in (("eve", ()), ("otto", [role("observe")]))
    ]
    known = connect(address, pairs[1], TIMEOUT_S)
    known.sendall(PREFACE + frame(SETTINGS, 0, 0))
    assert known.recv(9)[3] == SETTINGS
    eve = (authority.file, *authority.sign("eve"))
    others = [connect(address, eve, TIMEOUT_S) for _ in range(MAX_ADMITTED + 1)]
    for one in others:
        one.sendall(PREFACE + frame(SETTINGS, 0, 0))
        assert one.recv(9)[3] == SETTINGS
    known.sendall(frame(PING, 0, 0, b"answered"))
    while not (got := known.recv(65536)).endswith(b"answered"):
        assert got
    for one in (known, *others):
        one.close()


async def reached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sent: bytes, calls_seen: int) -> bytes:
    """What of ``sent`` comes to gRPC's socket when the guard sees so many calls."""
    monkeypatch.setattr(connection, "SEEN_WITHIN_S", 1e6)
    monkeypatch.setattr(connection, "FLOOD_REST_S", 1e6)
    client, outer = socket.socketpair()
    got, turns = bytearray(), Turns()
    with client, socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "grpc.sock"))
        listener.listen()
        way = connection.Way(turns, tmp_path / "grpc.sock", None, lambda _: None, lambda _: None, lambda _: 1)
        passing = connection.Connection(outer, way)
        client.sendall(sent)
        for rounds in range(calls_seen + 1):
            for _ in range(200):
                await asyncio.sleep(0)
            if rounds < calls_seen:
                passing.seen()
        inner, _ = listener.accept()
        with inner:
            inner.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                while True:
                    got += inner.recv(1 << 20)
        passing.close()
        turns.close()
    return bytes(got)


@pytest.mark.parametrize("calls_seen", [0, 1, 5])
def test_of_many_calls_grpc_is_given_the_next_when_the_guard_sees_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, calls_seen: int
) -> None:
    """gRPC throws calls away at random where hundreds wait for it, those of others, too."""
    calls = [frame(HEADERS, END_HEADERS, number, head_of_call("/Stop")) for number in range(1, 60, 2)]
    got = asyncio.run(reached(tmp_path, monkeypatch, PREFACE + b"".join(calls), calls_seen))
    assert got == PREFACE + b"".join(calls[: calls_seen + 1])


def test_a_flood_of_frames_that_are_no_calls_is_passed_on_slowly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    got = asyncio.run(reached(tmp_path, monkeypatch, PREFACE + frame(PING, 0, 0, bytes(8)) * 500, 0))
    assert len(PREFACE) < len(got) <= len(PREFACE) + 17 * MOST_FRAMES


def test_the_socket_takes_a_newcomer_however_many_are_there(tmp_path: Path) -> None:
    server, _ = serve(f"unix:{tmp_path}/o.sock")
    idle: list[socket.socket] = []
    try:
        idle += [connect(server.address, timeout_s=TIMEOUT_S) for _ in range(MAX_NEWCOMERS + 5)]
        assert idle[4].recv(1) == b""
        idle[-1].sendall(PREFACE + frame(SETTINGS, 0, 0))
        assert idle[-1].recv(9)[3] == SETTINGS
    finally:
        for one in idle:
            one.close()
        server.close()
