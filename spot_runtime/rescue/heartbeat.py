"""What a process in control and its guardian show each other: that both work, and how the robot is left.

The two share three bytes of memory, so that neither waits for the other, nor for a disk.
"""

from __future__ import annotations

import mmap
import os
import weakref
from enum import IntEnum
from typing import Final

_COUNT: Final = 0
_HOLD: Final = 1
_LOOKS: Final = 2
_BYTES: Final = 3


class Hold(IntEnum):
    """What the process in control has of the robot."""

    IN_HAND = 0
    """It must beat."""
    LET_GO = 1
    """It is done with the robot, which may have power; it must still end, or beat."""
    AT_REST = 2
    """The robot has no power: nothing is left to do."""


class Heartbeat:
    """Shared bytes: a count that rises while the process works, what it has of the robot, and whether it is watched."""

    def __init__(self, descriptor: int) -> None:
        """Share the memory of a descriptor, which is closed with this object."""
        self.descriptor = descriptor
        weakref.finalize(self, os.close, descriptor)
        self._shared = mmap.mmap(descriptor, _BYTES)

    @staticmethod
    def new() -> Heartbeat:
        """One that nobody shares yet. Raises OSError."""
        descriptor = os.memfd_create("heartbeat")
        os.ftruncate(descriptor, _BYTES)
        return Heartbeat(descriptor)

    def beat(self) -> None:
        """The process works."""
        self._shared[_COUNT] = (self._shared[_COUNT] + 1) & 0xFF

    @property
    def count(self) -> int:
        """Of beats, modulo 256."""
        return self._shared[_COUNT]

    @property
    def hold(self) -> Hold:
        """As last told."""
        return Hold(self._shared[_HOLD])

    @hold.setter
    def hold(self, hold: Hold) -> None:
        self._shared[_HOLD] = hold

    @property
    def looks(self) -> int:
        """How often a guardian has looked, 1 to 255 and again; 0: none has begun to watch."""
        return self._shared[_LOOKS]

    @looks.setter
    def looks(self, looks: int) -> None:
        self._shared[_LOOKS] = looks

    def look(self) -> None:
        """A guardian watches."""
        self.looks = self.looks % 255 + 1
