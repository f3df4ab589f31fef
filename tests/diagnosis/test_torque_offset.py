"""A constant torque against what looks like it; and effects that logs cannot show."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.channels import Channel
from diagnosis.decision_constants import GROUP_ODDS
from diagnosis.library.registry import LIBRARY
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.scoring import Scored
from diagnosis.selection.search import ranked
from diagnosis.verdict.advice import cannot_show
from spot_model.effects.base import Effect
from spot_model.effects.bodies import GroundFriction
from spot_model.effects.drivetrain import TorqueOffset, TorqueRipple
from spot_model.effects.joint_sensors import EncoderOffset, LoadSensorGain

from .cases import evidence_over
from .planted import Truth, planted_runs, walk_sequence

ALIKE = ("torque_offset", "torque_ripple", "load_sensor_gain", "torque_gain", "encoder_offset", "payload_mass")


def _board(*effects: Effect, channels: tuple[Channel, ...] = tuple(Channel), duration_s: float = 3.0) -> Evidence:
    runs = planted_runs(Truth(effects=effects), 2, sequence=walk_sequence(duration_s))
    return evidence_over(runs, channels)


def _ranking(board: Evidence) -> tuple[Scored, ...]:
    return ranked(board, (), {name: LIBRARY[name] for name in ALIKE})


@pytest.mark.parametrize(
    "effect",
    [
        TorqueOffset(joints=("hl_hy",), offset_nm=5.0),
        LoadSensorGain(joints=("hl_hy",), bias_nm=5.0),
        EncoderOffset(joints=("hl_hy",), offset_rad=0.04),
        TorqueRipple(joints=("hl_hy",), amplitude_nm=3.0, cycles_per_rad=12.0),
    ],
    ids=lambda e: e.name,
)
def test_a_constant_torque_is_told_from_a_zero_and_a_ripple(effect: Effect) -> None:
    board = _board(effect)
    best, second = _ranking(board)[:2]
    term = best.terms[-1]
    assert term.effect.name == effect.name
    assert board.robot.named(board.robot.joints_of(term.effect, term.place)) == effect.joints
    assert best.value - second.value > -np.log(GROUP_ODDS)


def test_between_set_point_and_load_alone_a_torque_and_a_cells_zero_are_one() -> None:
    board = _board(TorqueOffset(joints=("hl_hy",), offset_nm=5.0), channels=(Channel.SET_POINT_TO_LOAD,))
    by_name = {r.terms[-1].effect.name: r.value for r in _ranking(board)}
    assert abs(by_name["torque_offset"] - by_name["load_sensor_gain"]) < -np.log(GROUP_ODDS)


def test_grip_shows_where_feet_slip() -> None:
    # The gait asks for less grip than either ground has, until it has nearly none.
    assert "ground_friction" in cannot_show(_board())
    assert "ground_friction" not in cannot_show(_board(GroundFriction(scale=0.25), duration_s=8.0))


def test_what_shows_in_a_channel_is_shown_and_what_has_none_is_not() -> None:
    board = _board(channels=(Channel.SET_POINT_TO_LOAD,))
    hidden = cannot_show(board)
    # What was tried is known by its products: no column is made again.
    board.forget()
    assert cannot_show(board) == hidden
    assert not board._cache
    assert {"payload_mass", "encoder_offset", "ground_friction", "command_delay"} <= set(hidden)
    assert not {"torque_gain", "torque_offset", "armature", "coulomb_friction", "torque_limit"} & set(hidden)
