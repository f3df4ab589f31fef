"""Requests that wait for an answer of the control process, and who holds the right to steer."""

from __future__ import annotations

import time
from concurrent.futures import Future
from typing import Final

from spot_protos import run_link_pb2
from spot_runtime.operator.refusal import not_now

STEERING_HELD_S: Final = 1.0


class PendingRequests:
    """All that wait, by number. Its owner's lock guards it."""

    def __init__(self) -> None:
        self._count = 0
        self._waiting: dict[int, Future[run_link_pb2.Answer]] = {}

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, request: run_link_pb2.ToRun) -> Future[run_link_pb2.Answer]:
        """Number a request that is about to be sent. Returns its answer to come; cancelled, none will."""
        self._count += 1
        request.request_id = self._count
        pending = self._waiting[self._count] = Future()
        return pending

    def take(self, answer: run_link_pb2.Answer) -> None:
        """An answer has come."""
        pending = self._waiting.get(answer.request_id)
        if pending is not None and not pending.done():
            pending.set_result(answer)

    def forget(self, request_id: int) -> None:
        """The request is no longer waited for."""
        self._waiting.pop(request_id, None)

    def let_all_go(self) -> None:
        """Release all requests that wait: no answer will come."""
        for pending in list(self._waiting.values()):
            pending.cancel()


class SteeringRight:
    """Belongs to whoever steered last, for :data:`STEERING_HELD_S`. Its owner's lock guards it."""

    def __init__(self) -> None:
        self._held_by, self._since_s = ("", ""), -STEERING_HELD_S

    @property
    def holder(self) -> str:
        """Who steers; empty: nobody."""
        identity, name = self._held_by
        return (name or identity) if time.monotonic() - self._since_s < STEERING_HELD_S else ""

    def check(self, identity: str, name: str) -> None:
        """Refuse anybody but the holder. Raises Refusal."""
        if self.holder and (identity, name) != self._held_by:
            raise not_now(f"velocity: {self.holder} steers; wait until they stop")

    def take(self, identity: str, name: str) -> None:
        """They steer now."""
        self._held_by, self._since_s = (identity, name), time.monotonic()
