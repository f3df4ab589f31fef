"""Columns read straight from wire bytes are those that protobuf reads, or are left to it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spot_log.format.tables import ImuTable, StateTable, Table
from spot_log.read.columns import Parsed, UnusualError, Wire
from spot_protos import log_pb2

WIDTHS = {"joints": 12, "feet": 4}


def state(seed: int, *, n_imu: int = 2, **given: Any) -> log_pb2.State:
    rng = np.random.default_rng(seed)
    imu = [
        log_pb2.ImuPacket(
            robot_stamp_ns=int(rng.integers(1 << 62)),
            acceleration_of_imu_in_link_m_s2=rng.normal(size=3),
            angular_vel_of_link_in_link_rad_s=rng.normal(size=3),
            odom_from_link_wxyz=rng.normal(size=4),
        )
        for _ in range(n_imu)
    ]
    values: dict[str, Any] = {
        "robot_stamp_ns": int(rng.integers(-(1 << 62), 1 << 62)),
        "host_stamp_ns": int(rng.integers(1 << int(rng.integers(1, 62)))),
        "position_rad": rng.normal(size=12),
        "velocity_rad_s": rng.normal(size=12),
        "load_nm": rng.normal(size=12),
        "position_of_body_in_odom_m": rng.normal(size=3),
        "odom_from_body_wxyz": rng.normal(size=4),
        "linear_vel_of_body_in_odom_m_s": rng.normal(size=3),
        "angular_vel_of_body_in_odom_rad_s": rng.normal(size=3),
        "foot_contact": (rng.random(4) < 0.5).tolist(),
        "last_command_key": int(rng.integers(1 << 20)),
        "last_command_robot_stamp_ns": int(rng.integers(1 << 62)),
        "imu": imu,
    }
    return log_pb2.State(**{**values, **given})


def read(raws: list[bytes]) -> tuple[StateTable, ImuTable, list[int]]:
    lengths = np.array([len(raw) for raw in raws])
    buffer = np.frombuffer(b"".join([*raws, bytes(16)]), np.uint8)
    wire = Wire.of(buffer, np.cumsum(lengths) - lengths, lengths, log_pb2.State.DESCRIPTOR)
    packets, counts = wire.part("imu")
    imu = packets.table(ImuTable, {}, state_index=np.zeros(counts.sum(), dtype=np.int64))
    return wire.table(StateTable, WIDTHS, sequence=np.zeros(len(raws), dtype=np.int64)), imu, counts.tolist()


def assert_equal(found: Table, want: Table) -> None:
    for name in want.columns():
        assert getattr(found, name).dtype == getattr(want, name).dtype
        np.testing.assert_array_equal(getattr(found, name), getattr(want, name), err_msg=name)


def parsed(rows: list[log_pb2.State]) -> tuple[StateTable, ImuTable, list[int]]:
    packets, counts = Parsed(rows).part("imu")
    imu = packets.table(ImuTable, {}, state_index=np.zeros(counts.sum(), dtype=np.int64))
    table = Parsed(rows).table(StateTable, WIDTHS, sequence=np.zeros(len(rows), dtype=np.int64))
    return table, imu, counts.tolist()


@given(st.lists(st.tuples(st.integers(0, 1000), st.integers(0, 3), st.booleans()), min_size=1, max_size=12))
@settings(deadline=None, max_examples=60)
def test_columns_are_those_of_protobuf(drawn: list[tuple[int, int, bool]]) -> None:
    rows = [state(seed, n_imu=n, **({"last_command_key": 0} if is_first else {})) for seed, n, is_first in drawn]
    found, want = read([row.SerializeToString() for row in rows]), parsed(rows)
    assert_equal(found[0], want[0])
    assert_equal(found[1], want[1])
    assert found[2] == want[2]


@given(st.integers(0, 50), st.lists(st.tuples(st.integers(0, 5000), st.integers(0, 255)), min_size=1, max_size=4))
@settings(deadline=None, max_examples=400)
def test_damaged_bytes_that_are_read_are_read_as_protobuf_does(seed: int, changes: list[tuple[int, int]]) -> None:
    data = bytearray(state(seed).SerializeToString())
    for place, byte in changes:
        data[place % len(data)] = byte
    try:
        found = read([bytes(data)])
    except UnusualError:
        return
    want = parsed([log_pb2.State.FromString(bytes(data))])
    assert_equal(found[0], want[0])
    assert_equal(found[1], want[1])
    assert found[2] == want[2]


@pytest.mark.parametrize(
    "odd",
    [
        state(1, position_rad=[0.0] * 11).SerializeToString(),
        state(1, foot_contact=[]).SerializeToString(),
        state(1, last_command_key=1 << 31).SerializeToString(),
        state(1).SerializeToString() + b"\xf8\x07\x01",  # a field of a later version
        state(1).SerializeToString() + b"\x08\x05",  # a stamp for the second time
        state(1).SerializeToString()[:-3],
        b"\xff",
    ],
    ids=["narrow", "no feet", "long key", "unknown field", "twice", "cut", "no message"],
)
def test_what_is_unusual_is_left_to_protobuf(odd: bytes) -> None:
    usual = [state(i).SerializeToString() for i in range(3)]
    read(usual)
    with pytest.raises(UnusualError):
        read([*usual, odd])


def test_a_contact_that_is_neither_0_nor_1_is_not_taken_for_the_layout_of_others() -> None:
    usual = state(1, foot_contact=[True] * 4).SerializeToString()
    place = usual.index(bytes([10 << 3 | 2, 4, 1, 1, 1, 1]))
    odd = usual[: place + 2] + b"\x81\x00\x01\x01" + usual[place + 6 :]  # three numbers in four bytes
    assert list(log_pb2.State.FromString(odd).foot_contact) == [True] * 3
    table, _, _ = read([usual, usual])
    assert table.foot_contact.all()
    with pytest.raises(UnusualError):
        read([usual, odd])
