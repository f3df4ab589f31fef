"""One connection to the service: who is at its other end, then its frames, in turns, to gRPC's own socket."""

from __future__ import annotations

import asyncio
import os
import select
import socket
import ssl
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Final, NamedTuple

from spot_runtime.operator.door.callers import Caller, caller_of, peer_of
from spot_runtime.operator.door.turns import Place, Turns

PART_BYTES: Final = 16_384
WOULD_BLOCK: Final = (BlockingIOError, InterruptedError, ssl.SSLWantReadError, ssl.SSLWantWriteError)


class Outflow:
    """One direction of a connection: never more than one part of it in memory."""

    def __init__(self, source: socket.socket, target: socket.socket, on_end: Callable[[], None]) -> None:
        """Begin to pass on; ``on_end`` is called when either socket has gone."""
        self._source, self._target, self._on_end = source, target, on_end
        self._loop = asyncio.get_running_loop()
        self._left = memoryview(b"")
        self._loop.add_reader(source, self._read)

    def close(self) -> None:
        """Pass on nothing any more; the sockets are their owner's."""
        self._loop.remove_reader(self._source)
        self._loop.remove_writer(self._target)

    def _read(self) -> None:
        try:
            data = self._source.recv(PART_BYTES)
        except WOULD_BLOCK:
            return
        except OSError:
            data = b""
        if not data:
            self._on_end()
            return
        self._left = memoryview(data)
        self._write()

    def _write(self) -> None:
        try:
            self._left = self._left[self._target.send(self._left) :]
        except WOULD_BLOCK:
            pass
        except OSError:
            self._on_end()
            return
        if self._left:
            self._loop.remove_reader(self._source)
            self._loop.add_writer(self._target, self._write)
        else:
            self._loop.remove_writer(self._target)
            self._loop.add_reader(self._source, self._read)


PREFACE_BYTES: Final = 24
HEAD_BYTES: Final = 9
HEADERS: Final = 1
MOST_FRAMES: Final = 32
"""Of a turn. gRPC needs some microseconds for each that begins no call."""


class Frames:
    """Cuts a client's stream of bytes into parts that may be passed on in one turn."""

    def __init__(self) -> None:
        self._rest = PREFACE_BYTES
        self.is_at_call = False
        """Whether the next frame begins a call, which the last cut did not let through."""

    def cut(self, data: bytes | bytearray, *, may_call: bool) -> tuple[int, bool]:
        """The first bytes of ``data`` that may pass now: at most one call's beginning, and no more than some frames.

        ``data`` is what has come and was not cut off before; ``may_call`` says whether one call may begin. Returns how
        many bytes, and whether a call begins in them.
        """
        at, has_call, self.is_at_call = 0, False, False
        for _ in range(MOST_FRAMES):
            passing = min(self._rest, len(data) - at)
            at, self._rest = at + passing, self._rest - passing
            if self._rest or len(data) - at < HEAD_BYTES:
                break
            if data[at + 3] == HEADERS:
                if has_call or not may_call:
                    self.is_at_call = True
                    break
                has_call = True
            self._rest = HEAD_BYTES + int.from_bytes(data[at : at + 3], "big")
        return at, has_call


SEEN_WITHIN_S: Final = 0.1
"""Time for which a connection's next call waits for gRPC to show the one before; it may have been broken off."""

FLOOD_REST_S: Final = 0.02
"""After a turn in which a client had sent more than may pass, other than calls; for each of its connections, so that a
second one gets it nothing."""

_numbers = count(1)


class Way(NamedTuple):
    """What all connections share, and whom they tell."""

    turns: Turns
    inner_path: Path
    """Where gRPC listens."""
    tls: ssl.SSLContext | None
    met: Callable[[Connection], None]
    """Told when a client has gone on with its handshake, and when it is known who calls."""
    ended: Callable[[Connection], None]
    """Told once, when either end has gone."""
    crowd: Callable[[Connection], int]
    """How many connections share what this one may send."""


class Connection:
    """An accepted connection. It is known to gRPC by :attr:`name`."""

    def __init__(self, outer: socket.socket, way: Way) -> None:
        """Take over an accepted socket; call it from the event loop. Raises OSError where the client has gone."""
        self.peer = peer_of(outer)
        self.group = self.peer.group
        """Whose share of turns and connections it takes."""
        self.caller: Caller | None = None
        """Who calls; None before the handshake of TLS is done."""
        self.name = f"spot-rl-{os.getpid()}-{next(_numbers)}"
        self.is_greeted = False
        """Whether the first half of a handshake is done."""
        self.is_admitted = False
        """Whether a client with a role is known to be at its other end; the door says so."""
        self.stops_open = 0
        """Calls under way that stop the robot."""
        self.used_s = self.born_s = time.monotonic()
        self._outer, self._way = outer, way
        self._inner: socket.socket | None = None
        self._answers: Outflow | None = None
        self._held, self._cut = bytearray(), memoryview(b"")
        self._frames, self._unseen = Frames(), False
        self._timers: dict[str, asyncio.TimerHandle] = {}
        self._is_resting = self._is_over = False
        self._loop = asyncio.get_running_loop()
        outer.setblocking(False)
        if way.tls is not None:
            self._outer = way.tls.wrap_socket(outer, server_side=True, do_handshake_on_connect=False)
        self._loop.add_reader(self._outer, self._wake)

    def turn(self) -> None:
        """Do a little: a step of the handshake, or pass on what may pass now."""
        try:
            if self._inner is None and has_hung_up(self._outer):  # most have in a storm of them: they shall cost little
                self.close()
            elif self.caller is None:
                self._meet()
            elif self._inner is None:
                self._open()
            else:
                self._pass_on(self._inner)
        except ssl.SSLWantWriteError:
            self._loop.add_writer(self._outer, self._wake)
        except WOULD_BLOCK:
            self._loop.add_reader(self._outer, self._wake)
        except (OSError, ValueError):
            self.close()

    def seen(self) -> None:
        """The guard sees the call that was passed on last, so the next may follow."""
        self._unseen = False
        if self._frames.is_at_call:
            self._ask()

    def rest(self, duration_s: float) -> None:
        """Pass nothing on for a while."""
        self._is_resting = True
        self._later("rest", duration_s, self._rested)

    def close(self) -> None:
        """Cut it; a second call does nothing."""
        if self._is_over:
            return
        self._is_over = True
        for timer in self._timers.values():
            timer.cancel()
        self._way.turns.withdraw(self.turn)
        self._loop.remove_reader(self._outer)
        self._loop.remove_writer(self._outer)
        if self._answers is not None:
            self._answers.close()
        if self._inner is not None:
            self._loop.remove_writer(self._inner)
            self._inner.close()
        self._outer.close()
        self._way.ended(self)

    def _meet(self) -> None:
        """Find out who calls."""
        outer = self._outer
        certificate: bytes | None = None
        if isinstance(outer, ssl.SSLSocket):
            try:
                outer.do_handshake()
            except ssl.SSLWantReadError:
                if outer.cipher() is not None and not self.is_greeted:
                    self.is_greeted = True
                    self._way.met(self)
                raise
            certificate = outer.getpeercert(binary_form=True)
        self.caller = caller_of(certificate, self.peer, is_tls=self._way.tls is not None)
        self._way.met(self)
        self._ask()

    def _open(self) -> None:
        """Connect to gRPC, under a name that tells its connections apart."""
        inner = self._inner = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        inner.setblocking(False)
        inner.bind(f"\0{self.name}")
        inner.connect(str(self._way.inner_path))
        self._answers = Outflow(inner, self._outer, self.close)
        self._ask()

    def _pass_on(self, inner: socket.socket) -> None:
        is_dry = self._fill()
        if not self._cut:
            size, has_call = self._frames.cut(self._held, may_call=not self._unseen)
            self._cut = memoryview(bytes(self._held[:size]))
            del self._held[:size]
            if has_call:
                self._unseen = True
                self._later("seen", SEEN_WITHIN_S, self.seen)
        try:
            self._cut = self._cut[inner.send(self._cut) :] if self._cut else self._cut
        except WOULD_BLOCK:
            self._loop.add_writer(inner, self._wake)
            return
        if self._frames.is_at_call and self._unseen:
            return  # its turn comes when the call before is seen
        if self._cut or self._frames.is_at_call:
            self._ask()
        elif not is_dry or len(self._held) >= HEAD_BYTES:
            self.rest(FLOOD_REST_S * self._way.crowd(self))
        else:
            self._loop.add_reader(self._outer, self._wake)

    def _fill(self) -> bool:
        """Read until there is enough for a turn. Returns whether there is no more."""
        while len(self._held) < PART_BYTES:
            try:
                data = self._outer.recv(PART_BYTES - len(self._held))
            except WOULD_BLOCK:
                return True
            if not data:
                raise ConnectionResetError("the client has gone")
            self._held += data
        return False

    def _ask(self) -> None:
        if not (self._is_over or self._is_resting):
            self._way.turns.ask(self.turn, Place(self.is_admitted, self.group))

    def _wake(self) -> None:
        """Something can be read, or written again."""
        self._loop.remove_reader(self._outer)
        self._loop.remove_writer(self._outer if self._inner is None else self._inner)
        self._ask()

    def _rested(self) -> None:
        self._is_resting = False
        self._ask()

    def _later(self, name: str, delay_s: float, act: Callable[[], None]) -> None:
        if name in self._timers:
            self._timers[name].cancel()
        self._timers[name] = self._loop.call_later(delay_s, act)


def has_hung_up(end: socket.socket) -> bool:
    """Whether the other end has gone, though what it sent was not read yet."""
    poll = select.poll()
    poll.register(end, select.POLLRDHUP)
    return bool(poll.poll(0))
