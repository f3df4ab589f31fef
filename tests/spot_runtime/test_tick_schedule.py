"""The schedule keeps 50 Hz of robot time on average, whatever the stamps do."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spot_runtime.control.memory import TickSchedule, schedule_for

MS = 1_000_000


def ticks_of(stamps_ns: list[int], schedule: TickSchedule) -> tuple[TickSchedule, list[int], int]:
    """The stamps at which a tick was due, and how many ticks were lost."""
    due, lost = [], 0
    for stamp in stamps_ns:
        schedule, is_due, missed = schedule.advance(stamp)
        lost += missed
        if is_due:
            due.append(stamp)
    return schedule, due, lost


def test_a_3_ms_stream_gives_steps_of_7_7_6_messages() -> None:
    _, due, lost = ticks_of([i * 3 * MS for i in range(1000)], schedule_for(50.0))
    steps = (np.diff(due) // (3 * MS)).tolist()
    assert steps[:6] == [7, 7, 6, 7, 7, 6]
    assert lost == 0


def test_the_average_rate_is_exactly_50_hz() -> None:
    _, due, _ = ticks_of([i * 3 * MS for i in range(20_001)], schedule_for(50.0))
    # 60 s and the tick at its start: 60.000 s hold 3001 due instants.
    assert len(due) == 3001
    assert due[-1] - due[0] == 60_000 * MS


def test_events_are_not_counted_but_stamps() -> None:
    """Half of the messages missing changes when a tick happens, not how many there are."""
    stamps = [i * 3 * MS for i in range(20_001) if i % 2 == 0]
    _, due, lost = ticks_of(stamps, schedule_for(50.0))
    assert len(due) == 3001
    assert lost == 0


@given(st.lists(st.integers(-900_000, 900_000), min_size=400, max_size=400))
def test_jitter_of_the_stamps_never_loses_a_tick(jitter_ns: list[int]) -> None:
    stamps = [100 * MS + i * 3 * MS + j for i, j in enumerate(jitter_ns)]
    schedule, due, lost = ticks_of(stamps, schedule_for(50.0))
    assert lost == 0
    expected = 1 + (stamps[-1] - due[0]) // (20 * MS)
    assert len(due) == expected
    assert schedule.next_due_robot_ns is not None
    assert (schedule.next_due_robot_ns - due[0]) % (20 * MS) == 0


@given(st.integers(1, 50), st.integers(1, 200))
def test_a_gap_loses_whole_ticks_and_the_schedule_stays_where_it_was(before: int, gap_messages: int) -> None:
    stamps = [i * 3 * MS for i in range(before)]
    stamps += [stamps[-1] + gap_messages * 3 * MS + i * 3 * MS for i in range(20)]
    schedule, due, lost = ticks_of(stamps, schedule_for(50.0))
    assert len(due) + lost == 1 + stamps[-1] // (20 * MS)
    assert schedule.ticks == len(due)


def test_a_gap_worked_out_by_hand() -> None:
    """Ticks at 0 and 21 ms; then nothing until 75 ms: the instants 40 and 60 ms are over, 60 counts as this tick."""
    schedule, due, lost = ticks_of([0, 3 * MS, 21 * MS, 75 * MS, 78 * MS, 81 * MS], schedule_for(50.0))
    assert due == [0, 21 * MS, 75 * MS, 81 * MS]
    assert lost == 1
    assert schedule.next_due_robot_ns == 100 * MS


@pytest.mark.parametrize(("rate_hz", "period_ns"), [(50.0, 20 * MS), (100.0, 10 * MS), (333.0, 3_003_003)])
def test_the_period_follows_the_contract(rate_hz: float, period_ns: int) -> None:
    assert schedule_for(rate_hz).period_ns == period_ns
