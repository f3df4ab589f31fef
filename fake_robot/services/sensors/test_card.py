"""A test card as grey pixels or JPEG: what the fake's cameras show, for they see nothing. No imaging library needed."""

from __future__ import annotations

import struct
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

BLOCK = 8
"""Pixels of one side of a field. JPEG codes such blocks, and a block of one grey is one number."""
_DARK, _LIGHT, _RANGE = 40, 110, 100

# Table K.3 of ITU-T T.81: the lengths and symbols of the usual code for DC differences of luminance.
_DC_COUNTS = (0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0)
_DC_SYMBOLS = tuple(range(12))
# A code with one word of one bit: the end of the block, as there is nothing but the DC value.
_AC_COUNTS, _AC_SYMBOLS = (1, *[0] * 15), (0,)
_END_OF_BLOCK = "0"


@lru_cache(maxsize=64)
def fields(cols: int, rows: int) -> NDArray[np.uint8]:
    """Grey of each field: a chessboard that gets lighter to the right, so that up, down, left and right differ."""
    width, height = -(-cols // BLOCK), -(-rows // BLOCK)
    y, x = np.mgrid[0:height, 0:width]
    checks = np.where((x + y) % 2 == 0, _DARK, _LIGHT)
    card = checks + (x * _RANGE) // max(1, width - 1)
    card[: height // 4, : width // 4] = 255 - card[: height // 4, : width // 4]
    return np.asarray(card, dtype=np.uint8)


@lru_cache(maxsize=32)
def raw(cols: int, rows: int) -> bytes:
    """The card's pixels, one byte each, row by row."""
    return np.kron(fields(cols, rows), np.ones((BLOCK, BLOCK), dtype=np.uint8))[:rows, :cols].tobytes()


@lru_cache(maxsize=32)
def jpeg(cols: int, rows: int) -> bytes:
    """The card as a baseline JPEG of one component, without loss: quantised by 1, DC values alone."""
    # The DC coefficient of a block of one grey is eight times its distance from 128.
    values = 8 * (fields(cols, rows).astype(int).ravel() - 128)
    codes = _dc_codes()
    bits = []
    for difference in np.diff(values, prepend=0).tolist():
        size = abs(difference).bit_length()
        bits.append(codes[size])
        if size:
            bits.append(format(difference if difference > 0 else difference + (1 << size) - 1, f"0{size}b"))
        bits.append(_END_OF_BLOCK)
    text = "".join(bits)
    text += "1" * (-len(text) % 8)
    scan = int(text, 2).to_bytes(len(text) // 8, "big").replace(b"\xff", b"\xff\x00")
    return b"".join(
        [
            b"\xff\xd8",
            _segment(0xE0, b"JFIF\x00\x01\x01\x00\x00\x01\x00\x01\x00\x00"),
            _segment(0xDB, b"\x00" + b"\x01" * 64),
            _segment(0xC0, struct.pack(">BHHB3B", 8, rows, cols, 1, 1, 0x11, 0)),
            _segment(0xC4, bytes([0x00, *_DC_COUNTS, *_DC_SYMBOLS])),
            _segment(0xC4, bytes([0x10, *_AC_COUNTS, *_AC_SYMBOLS])),
            _segment(0xDA, bytes([1, 1, 0x00, 0, 63, 0])),
            scan,
            b"\xff\xd9",
        ]
    )


def _segment(marker: int, content: bytes) -> bytes:
    return bytes([0xFF, marker]) + struct.pack(">H", len(content) + 2) + content


def _dc_codes() -> list[str]:
    """The code word of each size of a difference: canonical, by length (T.81, annex C)."""
    words, code = [], 0
    for length, count in enumerate(_DC_COUNTS, start=1):
        for _ in range(count):
            words.append(format(code, f"0{length}b"))
            code += 1
        code <<= 1
    return words
