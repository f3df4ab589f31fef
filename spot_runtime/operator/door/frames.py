"""HTTP/2 from outside: where its frames end, and which of them begin a call. Source: RFC 9113, sections 3.4 and 4.1."""

from __future__ import annotations

from typing import Final

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

        Args:
            data: What has come and was not cut off before.
            may_call: Whether one call may begin.

        Returns:
            How many bytes, and whether a call begins in them.
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
