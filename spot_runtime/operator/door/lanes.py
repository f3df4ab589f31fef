"""Threads that carry calls out, in lanes: one that is full, or whose calls wait, holds up no other."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Final, TypeVar

import grpc

from spot_runtime.operator.door.access import Lane
from spot_runtime.operator.refusal import Refusal

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
