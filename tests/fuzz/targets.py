"""What is fuzzed: each parser as a function of bytes, which may refuse in its own words and do nothing else.

A target returns, or raises what its parser promises; anything else is a finding.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np
from files import FILES
from logs import LOGS
from operator_rpcs import OPERATOR_RPCS
from policy_files import POLICIES
from rpcs import RPCS
from wire import WIRE

TARGETS = {**POLICIES, **FILES, **LOGS, **WIRE, **RPCS, **OPERATOR_RPCS}


def changed(seeds: list[bytes], count: int, seed: int) -> Iterator[bytes]:
    """Seeds with random bytes, cuts, repetitions and words put in: the same ones for the same number."""
    rng = np.random.default_rng(seed)
    words = (b"\0", b"\xff" * 4, b"nan", b".inf", b"- - -", b"*a", b"&a ", b"{", b"[", b"1e999", b"null", b"\x80" * 9)
    for _ in range(count):
        data = bytearray(seeds[int(rng.integers(len(seeds)))])
        for _ in range(int(rng.integers(1, 6))):
            at = int(rng.integers(len(data) + 1))
            end = min(len(data), at + int(rng.integers(1, 16)))
            kind = int(rng.integers(5))
            if kind == 0:
                data[at:end] = rng.bytes(end - at)
            elif kind == 1:
                del data[at:end]
            elif kind == 2:
                data[at:at] = words[int(rng.integers(len(words)))]
            elif kind == 3:
                data[at:at] = data[at:end]
            elif len(data) > at:
                data[at] ^= 1 << int(rng.integers(8))
        yield bytes(data)


if sys.version_info < (3, 11):
    raise SystemExit("the fuzzer needs Python 3.11")
