"""What ``mcap``'s own readers read of our logs, whole and cut, and where they stop and ours goes on."""

from __future__ import annotations

import io
from collections import Counter

import pytest
from mcap.reader import NonSeekingReader, SeekingReader

from spot_log.read.mcap_scan import scan_mcap


def theirs(reader) -> tuple[list[tuple[str, int, int, bytes]], bool]:
    """Messages in the order of the file as far as the reader comes, and whether it came to an end by itself."""
    found = []
    try:
        for _, channel, message in reader.iter_messages(log_time_order=False):
            found.append((channel.topic, message.sequence, message.log_time, message.data))
    except Exception:  # noqa: BLE001 - what it raises on a cut file is not the point
        return found, False
    return found, True


def ours(data: bytes) -> list[tuple[str, int, int, bytes]]:
    return [(m.topic, m.sequence, m.log_ns, m.data) for m in scan_mcap(data).messages]


def test_a_whole_log_is_the_same_to_both(synthetic_log):
    data = synthetic_log.read_bytes()
    for reader in (SeekingReader(io.BytesIO(data), validate_crcs=True), NonSeekingReader(io.BytesIO(data))):
        found, is_whole = theirs(reader)
        assert is_whole
        assert Counter(found) == Counter(ours(data))


@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_a_cut_log_is_the_same_to_the_reader_that_does_not_seek(synthetic_log, share):
    data = synthetic_log.read_bytes()
    cut = data[: round(share * len(data))]
    found, _ = theirs(NonSeekingReader(io.BytesIO(cut), validate_crcs=True))
    assert found
    assert ours(cut) == found


def test_after_a_damaged_chunk_ours_goes_on(synthetic_log):
    data = bytearray(synthetic_log.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 64] = bytes(64)
    found, _ = theirs(NonSeekingReader(io.BytesIO(bytes(data)), validate_crcs=True))
    assert len(ours(bytes(data))) > len(found)
