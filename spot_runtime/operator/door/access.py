"""Which calls are let in or refused, by role and rate, and which threads carry them out."""

from __future__ import annotations

import asyncio
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from enum import Enum
from typing import Final, TypeVar

import grpc

from spot_runtime.operator.door.callers import ROLE_URI, Caller, Role


class Refusal(Exception):  # noqa: N818 - an answer, not a failure
    """The answer to a request that changed nothing."""

    def __init__(self, code: grpc.StatusCode, text: str) -> None:
        super().__init__(text)
        self.code = code
        self.text = text


def bad_request(text: str) -> Refusal:
    """The request itself is not valid, whatever the state."""
    return Refusal(grpc.StatusCode.INVALID_ARGUMENT, text)


def not_now(text: str) -> Refusal:
    """The request does not fit the state."""
    return Refusal(grpc.StatusCode.FAILED_PRECONDITION, text)


def unavailable(text: str) -> Refusal:
    """The service cannot carry it out, through no fault of the request."""
    return Refusal(grpc.StatusCode.UNAVAILABLE, text)


MAX_CLIENTS: Final = 256
MAX_STREAMS: Final = 32
MAX_STREAMS_OF_ONE: Final = 8
CONNECTIONS_WORTH: Final = 4
"""A caller with several connections may call as often as this many of them."""


class Lane(Enum):
    """Which threads carry a call out: a lane that is full holds up no other."""

    STOP = "stop"
    DAMP = "damp"
    ATTEND = "attend"
    STEER = "steer"
    ORDINARY = "ordinary"

    @property
    def is_reserved(self) -> bool:
        """Whether such a call is never too often."""
        return self in (Lane.STOP, Lane.DAMP, Lane.ATTEND)


class Buckets:
    """A bucket of tokens for each client; a call takes one, time fills them up again."""

    def __init__(self, rate_hz: float, *, now_s: Callable[[], float] = time.monotonic) -> None:
        """Allow ``rate_hz`` calls a second, and a second's worth at once."""
        self._rate_hz, self._now_s = rate_hz, now_s
        self._lock = threading.Lock()
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, client: str) -> bool:
        """Whether this client may call now."""
        now_s = self._now_s()
        with self._lock:
            tokens, since_s = self._buckets.pop(client, (self._rate_hz, now_s))
            tokens = min(self._rate_hz, tokens + (now_s - since_s) * self._rate_hz)
            is_allowed = tokens >= 1.0
            self._buckets[client] = (tokens - 1.0 if is_allowed else tokens, now_s)
            while len(self._buckets) > MAX_CLIENTS:
                self._buckets.popitem(last=False)
            return is_allowed


class Gate:
    """Lets calls in, or says why not."""

    def __init__(self, *, requests_per_s: float, steering_per_s: float) -> None:
        """Allow this many calls a second on each connection; steering is counted apart."""
        self._rates_hz = dict.fromkeys(Lane, requests_per_s) | {Lane.STEER: steering_per_s}
        self._buckets = {
            is_steering: (Buckets(rate_hz), Buckets(rate_hz * CONNECTIONS_WORTH))
            for is_steering, rate_hz in ((False, requests_per_s), (True, steering_per_s))
        }
        self._streams: list[str] = []
        self._lock = threading.Lock()

    def check_role(self, name: str, caller: Caller, needed: Role) -> None:
        """Refuse who has not the role; this comes before anything else of a call is looked at. Raises Refusal."""
        if caller.role is None:
            raise Refusal(
                grpc.StatusCode.PERMISSION_DENIED,
                f"{name}: the certificate of {caller.name!r} names no role; it needs the URI {ROLE_URI}observe or "
                f"{ROLE_URI}operate among its alternative names",
            )
        if needed is Role.OPERATE and caller.role is not Role.OPERATE:
            raise Refusal(
                grpc.StatusCode.PERMISSION_DENIED,
                f"{name} needs the role operate, and the certificate of {caller.name!r} has observe; use an operator's",
            )

    def check_rate(self, name: str, caller: Caller, connection: str, lane: Lane) -> None:
        """Refuse a client that calls too often; stop, damp and attend are never refused. Raises Refusal."""
        if lane.is_reserved:
            return
        of_connection, of_caller = self._buckets[lane is Lane.STEER]
        if not (of_connection.take(connection) and of_caller.take(caller.identity)):
            raise Refusal(
                grpc.StatusCode.RESOURCE_EXHAUSTED,
                f"{name}: more than {self._rates_hz[lane]:g} calls a second; call less often",
            )

    def open_stream(self, name: str, caller: Caller) -> None:
        """Take one of the streams; :meth:`close_stream` gives it back. Raises Refusal."""
        with self._lock:
            of_one = self._streams.count(caller.identity)
            if of_one >= MAX_STREAMS_OF_ONE or len(self._streams) >= MAX_STREAMS:
                bound = MAX_STREAMS_OF_ONE if of_one >= MAX_STREAMS_OF_ONE else MAX_STREAMS
                text = f"{name}: {bound} streams are open already; close one"
                raise Refusal(grpc.StatusCode.RESOURCE_EXHAUSTED, text)
            self._streams.append(caller.identity)

    def close_stream(self, caller: Caller) -> None:
        """Give a stream back."""
        with self._lock:
            self._streams.remove(caller.identity)


THREADS: Final = {Lane.STOP: 4, Lane.DAMP: 4, Lane.ATTEND: 2, Lane.STEER: 2, Lane.ORDINARY: 12}
MAX_UNDER_WAY: Final = 64
"""Calls in one lane, those that wait for a thread included."""

Answer = TypeVar("Answer")


class Lanes:
    """One pool of threads for each lane."""

    def __init__(self) -> None:
        self._pools = {lane: ThreadPoolExecutor(n, thread_name_prefix=lane.value) for lane, n in THREADS.items()}
        self._room = {lane: threading.BoundedSemaphore(MAX_UNDER_WAY) for lane in Lane}

    async def run(self, lane: Lane, work: Callable[..., Answer], *arguments: object) -> Answer:
        """Carry ``work`` out on a thread of the lane. Raises Refusal where too many calls are under way."""
        room = self._room[lane]
        if not room.acquire(blocking=False):
            text = f"{MAX_UNDER_WAY} calls of this kind are under way already; wait for one"
            raise Refusal(grpc.StatusCode.RESOURCE_EXHAUSTED, text)
        future = self._pools[lane].submit(work, *arguments)
        future.add_done_callback(lambda _: room.release())
        return await asyncio.wrap_future(future)

    def close(self) -> None:
        """Take no more calls; those under way go on by themselves."""
        for pool in self._pools.values():
            pool.shutdown(wait=False, cancel_futures=True)
