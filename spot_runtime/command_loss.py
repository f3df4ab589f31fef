"""How many commands the link loses, told from the keys that the robot confirms.

Two commands that reach the robot within one state period look as if the older one were lost, so a key that is passed
over alone says nothing. Jitter cannot make two in a row do so; with losses of share p that happens p²·(1 − p) times
a key.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

WINDOW_KEYS: Final = 500
"""Keys over which losses are counted: 1.5 s at a command a state."""


@dataclass(frozen=True)
class LossMemory:
    """What counting remembers."""

    first_key: int = 0
    """Where the window began; 0 before any confirmation."""
    newest_key: int = 0
    bursts: int = 0
    """How often two or more keys in a row were passed over, in this window."""
    share: float = 0.0
    """Estimated share of commands that were lost, over the last window that is full."""


def confirm(memory: LossMemory, key: int) -> LossMemory:
    """Take the key that the newest state confirms; one that is not newer changes nothing."""
    if key <= memory.newest_key:
        return memory
    if memory.first_key == 0:
        return LossMemory(first_key=key, newest_key=key)
    bursts = memory.bursts + (key - memory.newest_key > 2)
    if key - memory.first_key < WINDOW_KEYS:
        return replace(memory, newest_key=key, bursts=bursts)
    return LossMemory(first_key=key, newest_key=key, share=loss_share(bursts, key - memory.first_key))


def loss_share(bursts: int, keys: int) -> float:
    """The share p at which so many losses of two or more in a row are expected: p²·(1 − p) = bursts / keys."""
    wanted = bursts / keys
    low, high = 0.0, 2.0 / 3.0  # the left side rises up to here
    if wanted >= high * high * (1.0 - high):
        return high
    while high - low > 1e-4:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if middle * middle * (1.0 - middle) < wanted else (low, middle)
    return low
