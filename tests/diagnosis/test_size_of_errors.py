"""How large a robot's ordinary errors are: a number that a fault in one kind hardly moves."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.library.registry import LIBRARY
from diagnosis.selection.robot_models import SMALLEST, size_of_errors


def _board(names: Sequence[str], scale: Sequence[float], published: Sequence[float]) -> Any:
    kinds = tuple(SimpleNamespace(effect=LIBRARY[name]) for name in dict.fromkeys(names))
    ordinary = SimpleNamespace(
        names=tuple(names), kinds=kinds, scale=np.array(scale, float), published=np.array(published, float)
    )
    return SimpleNamespace(ordinary=ordinary)


def test_size_is_the_geometric_mean_of_the_kinds_root_mean_squares() -> None:
    board = _board(["torque_gain", "torque_gain", "armature"], [0.5, 0.5, 2.0], [1.0, 1.0, 1.0])
    # 3 and 4 times a half: root mean square 0.5·√12.5. One times 2.
    expected = np.sqrt(0.5 * np.sqrt(12.5) * 2.0)
    assert size_of_errors(board, np.array([3.0, -4.0, 1.0])) == pytest.approx(expected)


def test_a_load_cell_moves_no_robot() -> None:
    board = _board(["torque_gain", "load_sensor_gain"], [1.0, 1.0], [1.0, 1.0])
    assert size_of_errors(board, np.array([0.3, 50.0])) == pytest.approx(0.3)


def test_a_kind_without_any_error_counts_as_the_smallest() -> None:
    board = _board(["torque_gain", "armature"], [1.0, 1.0], [1.0, 1.0])
    assert size_of_errors(board, np.array([0.0, 1.0])) == pytest.approx(np.sqrt(SMALLEST))


def test_without_any_kind_errors_are_as_published() -> None:
    assert size_of_errors(_board([], [], []), np.zeros(0)) == 1.0
