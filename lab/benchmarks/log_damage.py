"""400 truncations and 400 bit flips of a log: each is recovered or refused in words, and only what was written is read.

python lab/benchmarks/log_damage.py LOG.mcap [TIMES]
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from spot_log import LogReadError, read_run, recover_log
from spot_log.read.mcap_scan import scan_mcap


def damaged(data: bytes, kind: str, rng: np.random.Generator) -> bytes:
    """The log, cut somewhere or with one bit flipped."""
    if kind == "cut":
        return data[: int(rng.integers(0, len(data)))]
    changed, bit = bytearray(data), int(rng.integers(0, 8 * len(data)))
    changed[bit // 8] ^= 1 << (bit % 8)
    return bytes(changed)


def outcome(path: Path, result: Path) -> str:
    """Recovered or refused; whatever else happens is raised."""
    try:
        states = len(read_run(path).states)
    except LogReadError as error:
        if str(path) not in str(error):
            raise
        return "refused"
    recover_log(path, result)
    if len(read_run(result).states) != states:
        raise AssertionError(f"{path}: {states} states were read, another number recovered")
    return "recovered"


def main() -> None:
    """Damage, read, count."""
    times = int(sys.argv[2]) if len(sys.argv) > 2 else 400
    data = Path(sys.argv[1]).read_bytes()
    written, rng, counts = set(scan_mcap(data).messages), np.random.default_rng(1), Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        path, result = Path(folder) / "damaged.mcap", Path(folder) / "result.mcap"
        for kind in ("cut", "bit flipped"):
            for _ in range(times):
                path.write_bytes(damaged(data, kind, rng))
                if not set(scan_mcap(path.read_bytes()).messages) <= written:
                    raise AssertionError("a message was read that nobody wrote")
                counts[f"{kind}, {outcome(path, result)}"] += 1
                result.unlink(missing_ok=True)
    print(f"{len(data)} bytes:", ", ".join(f"{count} {words}" for words, count in sorted(counts.items())))


if __name__ == "__main__":
    main()
