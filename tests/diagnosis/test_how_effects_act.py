"""What the library knows of how some effects act in time, each against a case worked out by hand."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from diagnosis.channels import Channel, Views
from diagnosis.library.program import waits
from diagnosis.verdict.evidence import _legs
from trainer.signals.motor_torque import presliding


def test_dry_friction_builds_up_over_its_distance_and_turns_with_the_motion() -> None:
    there = np.linspace(0.0, 0.1, 101)
    position = np.concatenate([there, there[-2::-1]])[:, None]
    felt = presliding(position, np.zeros(len(position), dtype=np.intp), 0.01)[:, 0]
    assert felt[10] == pytest.approx(1.0 - np.exp(-1.0))
    assert felt[100] == pytest.approx(1.0, abs=1e-3)
    assert felt[110] == pytest.approx(-1.0 + 2.0 * np.exp(-1.0), abs=1e-3)
    assert felt[-1] == pytest.approx(-1.0, abs=1e-3)


def test_dry_friction_begins_anew_with_each_recording() -> None:
    position = np.array([0.0, 1.0, 5.0, 5.0])[:, None]
    assert presliding(position, np.array([0, 0, 1, 1]), 0.01)[:, 0].tolist() == pytest.approx([0.0, 1.0, 0.0, 0.0])


def test_short_waits_overtake_no_command_and_long_ones_most() -> None:
    delay_s, spread_s, overtaken = waits(0.0005, 0.02)
    assert overtaken == 0.0
    assert delay_s == pytest.approx(0.0005, rel=0.05)
    assert 0.9 * delay_s < spread_s < delay_s
    rng, newest, lost = np.random.default_rng(5), -1.0, 0
    for k in range(20_000):
        arrives = 0.003 * k + rng.exponential(0.003)
        lost += arrives <= newest
        newest = max(newest, arrives)
    assert waits(0.003, 0.003)[2] == pytest.approx(lost / 20_000, abs=0.02)
    assert waits(0.03, 0.003)[2] > waits(0.003, 0.003)[2]


def test_legs_come_from_a_channel_that_knows_them() -> None:
    def view(legs: list[int]) -> Any:
        return SimpleNamespace(leg_of_joint=np.array(legs))

    unknown, known = view([-1, -1, -1, -1]), view([0, 0, 1, 1])
    assert _legs(cast("Views", {Channel.POLICY_REPLAY: unknown, Channel.SET_POINT_TO_LOAD: known})).tolist() == [
        0,
        0,
        1,
        1,
    ]
    assert _legs(cast("Views", {Channel.POLICY_REPLAY: unknown})).tolist() == [-1, -1, -1, -1]
