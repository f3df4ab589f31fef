"""Every parser on its seeds and on a few hundred changed ones; coverage-guided fuzzing of the same targets: run.py."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from targets import TARGETS, changed

COUNTS = {"policy": 60, "log_recovery": 40, "admin_row": 40, "operator": 80}


@pytest.mark.parametrize("name", TARGETS)
def test_no_input_is_a_crash(name: str) -> None:
    target = TARGETS[name]
    seeds = target.seeds()
    for data in seeds:
        assert len(data) <= max(target.max_len, 4001), "a seed longer than the fuzzer's inputs is cut"
        target.run(data)
    for data in changed(seeds, COUNTS.get(name, 200), seed=1):
        target.run(data)


def test_the_same_seed_gives_the_same_inputs() -> None:
    assert list(changed([b"abc"], 20, 1)) == list(changed([b"abc"], 20, 1))
    assert list(changed([b"abc"], 20, 1)) != list(changed([b"abc"], 20, 2))


def test_findings_found_once() -> None:
    """Inputs that once crashed a parser; each stays here."""
    for file in sorted((Path(__file__).parent / "findings").glob("*.*")):
        TARGETS[file.name.partition(".")[0]].run(file.read_bytes())


@pytest.mark.slow
def test_400_truncations_and_400_flipped_bits_of_a_log() -> None:
    """Each is recovered or refused in words, and never holds a message that nobody wrote."""
    import numpy as np
    from logs import recover, small_log

    from spot_log.read.mcap_scan import scan_mcap

    data = small_log()
    written, rng = set(scan_mcap(data).messages), np.random.default_rng(1)
    damaged = [data[: int(cut)] for cut in rng.integers(0, len(data), size=400)]
    for bit in rng.integers(0, 8 * len(data), size=400):
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << (int(bit) % 8)
        damaged.append(bytes(flipped))
    for log in damaged:
        assert set(scan_mcap(log).messages) <= written
        recover(log)
