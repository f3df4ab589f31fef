"""How many commands the link loses, told from the keys that the robot confirms.

Two commands that reach the robot within one state period look as if the older one were lost, so one or two keys that
are passed over say little. Three in a row need losses: of a share p, that happens p³·(1 − p) times a key.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

WINDOW_KEYS: Final = 1500
"""Keys over which losses are counted: 4.5 s at a command a state."""

IN_A_ROW: Final = 3


_SHARES: Final = np.arange(0.0, 0.75, 1e-4)
_BURSTS: Final = _SHARES**3 * (1.0 - _SHARES)
"""Bursts a key at each share; they rise up to 0.75."""


class LossMemory(NamedTuple):
    """What counting remembers."""

    first_key: int = 0
    """Where the window began; 0 before any confirmation."""
    newest_key: int = 0
    bursts: int = 0
    """How often three or more keys in a row were passed over, in this window."""
    share: float = 0.0
    """Estimated share of commands that were lost, over the last window that is full."""


def confirm(memory: LossMemory, key: int) -> LossMemory:
    """Take the key that the newest state confirms; an older one is that of another run, and counting begins anew."""
    if memory.first_key == 0 or key < memory.newest_key:
        return LossMemory(first_key=key, newest_key=key)
    bursts = memory.bursts + (key - memory.newest_key > IN_A_ROW)
    if key - memory.first_key < WINDOW_KEYS:
        return LossMemory(memory.first_key, key, bursts, memory.share)
    return LossMemory(first_key=key, newest_key=key, share=loss_share(bursts, key - memory.first_key))


def loss_share(bursts: int, keys: int) -> float:
    """The share p at which so many losses of three or more in a row are expected: p³·(1 − p) = bursts / keys."""
    return float(np.interp(bursts / keys, _BURSTS, _SHARES))
