"""Who goes next: those with a role and newcomers alternate, in each its peers, and of each peer its connections."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from typing import Final, Protocol

Ask = tuple[bool, str]


class Asker(Protocol):
    """Something that asks for turns."""

    def ask_of(self) -> Ask:
        """Whether it has a role, and whose share it takes."""

    def turn(self) -> None:
        """Do a little."""


class Turns:
    """Grants one turn in each round of the event loop.

    What a turn lets in is carried out in the same loop, so a flood waits here, where a stop overtakes it, and not in
    gRPC, where it would not.
    """

    def __init__(self) -> None:
        """Use it within one event loop."""
        self._loop: Final = asyncio.get_running_loop()
        self._waiting: dict[bool, OrderedDict[str, OrderedDict[Asker, None]]] = {
            has_role: OrderedDict() for has_role in (True, False)
        }
        self._places: dict[Asker, Ask] = {}
        self._handle: asyncio.Handle | None = None
        self._had_role = False

    def ask(self, asker: Asker) -> None:
        """Let it wait for its turn; whoever waits already keeps the place."""
        if asker in self._places:
            return
        has_role, peer = self._places[asker] = asker.ask_of()
        self._waiting[has_role].setdefault(peer, OrderedDict())[asker] = None
        if self._handle is None:
            self._handle = self._loop.call_soon(self._grant)

    def withdraw(self, asker: Asker) -> bool:
        """It waits no more. Returns whether it did."""
        place = self._places.pop(asker, None)
        if place is None:
            return False
        has_role, peer = place
        crowd = self._waiting[has_role][peer]
        del crowd[asker]
        if not crowd:
            del self._waiting[has_role][peer]
        return True

    def close(self) -> None:
        """Grant no more."""
        if self._handle is not None:
            self._handle.cancel()

    def _grant(self) -> None:
        self._handle = None
        if not self._places:
            return
        self._had_role = not self._had_role if self._waiting[not self._had_role] else self._had_role
        peers = self._waiting[self._had_role]
        peer = next(iter(peers))
        peers.move_to_end(peer)
        asker = next(iter(peers[peer]))
        self.withdraw(asker)
        if self._places:
            self._handle = self._loop.call_soon(self._grant)
        asker.turn()
