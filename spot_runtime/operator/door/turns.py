"""Who goes next: those with a role and newcomers alternate, in each its peers, and of each peer its connections."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable
from typing import NamedTuple

Turn = Callable[[], None]


class Place(NamedTuple):
    """Where somebody waits."""

    has_role: bool
    peer: str
    """Client whose share it takes."""


class Turns:
    """Grants one turn in each round of the event loop.

    What a turn lets in is carried out in the same loop, so a flood waits here, where a stop overtakes it, and not in
    gRPC, where it would not.
    """

    def __init__(self) -> None:
        """Use it within one event loop."""
        self._loop = asyncio.get_running_loop()
        self._peers: dict[bool, OrderedDict[str, OrderedDict[Turn, None]]] = {
            has_role: OrderedDict() for has_role in (True, False)
        }
        self._places: dict[Turn, Place] = {}
        self._handle: asyncio.Handle | None = None
        self._had_role = False

    def ask(self, turn: Turn, place: Place) -> None:
        """Call ``turn`` when it is due, once; what waits already keeps its place."""
        if turn in self._places:
            return
        self._places[turn] = place
        self._peers[place.has_role].setdefault(place.peer, OrderedDict())[turn] = None
        if self._handle is None:
            self._handle = self._loop.call_soon(self._grant)

    def withdraw(self, turn: Turn) -> bool:
        """It waits no more. Returns whether it did."""
        place = self._places.pop(turn, None)
        if place is None:
            return False
        peers = self._peers[place.has_role]
        del peers[place.peer][turn]
        if not peers[place.peer]:
            del peers[place.peer]
        return True

    def close(self) -> None:
        """Grant no more."""
        if self._handle is not None:
            self._handle.cancel()

    def _grant(self) -> None:
        self._handle = None
        if not self._places:
            return
        self._had_role = not self._had_role if self._peers[not self._had_role] else self._had_role
        peers = self._peers[self._had_role]
        peer = next(iter(peers))
        peers.move_to_end(peer)
        turn = next(iter(peers[peer]))
        self.withdraw(turn)
        if self._places:
            self._handle = self._loop.call_soon(self._grant)
        turn()
