"""The gaits of a log: one for each stretch of a held command."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from spot_log.tools.gaits import foot_descent_m_s, gait_line, gaits
from spot_model.robot import facts

STATE_HZ, TICK_HZ = 333.0, 50.0


def run_of(commands: list[tuple[float, float]], contact_of: Any) -> Any:
    """A log of (seconds, V_x) stretches; ``contact_of(t)`` gives the contacts, shape (n, 4)."""
    total = sum(seconds for seconds, _ in commands)
    state_s, tick_s = np.arange(0.0, total, 1 / STATE_HZ), np.arange(0.0, total, 1 / TICK_HZ)
    ends = np.cumsum([seconds for seconds, _ in commands])
    which = np.minimum(np.searchsorted(ends, tick_s, side="right"), len(commands) - 1)
    v_x = np.array([v for _, v in commands])[which]
    n = len(state_s)
    level, zero = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)), np.zeros((n, 3))
    states = SimpleNamespace(
        robot_stamp_ns=(state_s * 1e9).astype(np.int64) + 10**18,
        foot_contact=contact_of(state_s),
        position_rad=np.tile(facts.DEFAULT_POSITION_RAD, (n, 1)),
        velocity_rad_s=np.zeros((n, 12)),
        odom_from_body_wxyz=level,
        linear_vel_of_body_in_odom_m_s=zero - [0.0, 0.0, 0.4],
        angular_vel_of_body_in_odom_rad_s=zero,
    )
    ticks = SimpleNamespace(
        robot_stamp_ns=(tick_s * 1e9).astype(np.int64) + 10**18,
        action=np.zeros((len(tick_s), 12)),
        velocity_command=np.stack([v_x, 0 * v_x, 0 * v_x], axis=-1),
    )
    states_with_length, ticks_with_length = _Sized(states, n), _Sized(ticks, len(tick_s))
    return SimpleNamespace(states=states_with_length, ticks=ticks_with_length)


class _Sized:
    def __init__(self, table: SimpleNamespace, length: int) -> None:
        self.__dict__.update(vars(table))
        self._length = length

    def __len__(self) -> int:
        return self._length


def trotting(time_s: np.ndarray) -> np.ndarray:
    first = (time_s * 2.0) % 1.0 < 0.5
    return np.stack([first, ~first, ~first, first], axis=-1)


def test_each_held_command_has_its_gait_and_short_ones_have_none() -> None:
    found = gaits(run_of([(4.0, 0.5), (1.0, 0.8), (6.0, 1.0)], trotting))
    assert [span.command[0] for span in found] == [0.5, 1.0]
    assert [span.gait.name for span in found] == ["trot", "trot"]
    assert found[1].start_s == 6.0
    assert "2.0 strides/s" in gait_line(found[0])
    assert "touch-down at 0.40 m/s" in gait_line(found[0])


def test_a_ramp_is_one_stretch_and_steps_are_none() -> None:
    ramp = [(1 / 50, 0.002 * tick) for tick in range(300)]
    found = gaits(run_of([(4.0, 0.0), *ramp, (4.0, 0.6)], trotting))
    assert [(span.first_command[0], span.command[0]) for span in found] == [
        pytest.approx(pair, abs=0.005) for pair in ((0.0, 0.0), (0.0, 0.6), (0.6, 0.6))
    ]
    assert "(0.00 to 0.60, 0.00 m/s, 0.00 rad/s): trot" in gait_line(found[1])
    assert gaits(run_of([(1.0, 0.2 * step) for step in range(6)], trotting)) == []


def test_feet_move_with_a_body_that_sinks() -> None:
    np.testing.assert_allclose(foot_descent_m_s(run_of([(1.0, 0.0)], trotting)), 0.4)


def test_a_log_without_contacts_has_no_gaits() -> None:
    assert gaits(run_of([(6.0, 0.5)], lambda t: np.zeros((len(t), 0), dtype=bool))) == []
