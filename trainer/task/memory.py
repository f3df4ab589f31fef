"""Keep freed memory in the process; training frees and allocates it hundreds of times per iteration."""

from __future__ import annotations

import ctypes
from typing import Final

_TRIM_THRESHOLD: Final = -1
_MMAP_MAX: Final = -4
"""Parameters of glibc's mallopt(3)."""


def keep_freed_memory() -> None:
    """Let the C library keep what is freed, for the next time.

    By default glibc hands arrays above 32 MB back to the kernel at once. Learning on a CPU makes such arrays at every
    layer of every mini-batch, and each came back as 12,000 page faults. Where the C library has
    no such setting, nothing changes.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_MMAP_MAX, 0)
        mallopt(_TRIM_THRESHOLD, 2**31 - 1)
