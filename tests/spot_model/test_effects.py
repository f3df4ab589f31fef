from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from spot_model import facts
from spot_model.effects.base import Effect, Hook, Motion, TorqueEffect
from spot_model.effects.command_delay import CommandDelay
from spot_model.effects.coulomb_friction import CoulombFriction
from spot_model.effects.position_torque_limit import PositionTorqueLimit
from spot_model.effects.registry import BUILT_IN, effect_class, make_effect
from spot_model.effects.torque_limit import TorqueLimit
from spot_model.effects.torque_speed_curve import TorqueSpeedCurve
from spot_model.errors import BadInputError
from spot_model.knee_table import KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM

PAPER_CURVE = TorqueSpeedCurve(
    torque_max_nm=97.00,
    torque_min_nm=-108.79,
    speed_max_rad_s=25.03,
    speed_min_rad_s=-22.22,
    intersect_max_rad_s=9.48,
    intersect_min_rad_s=-8.32,
)


def random_joints(n: int = 64) -> tuple[np.ndarray, Motion]:
    rng = np.random.default_rng(7)
    torque = rng.normal(0.0, 80.0, (n, 12))
    position = rng.uniform(facts.POSITION_LOW_RAD - 0.1, facts.POSITION_HIGH_RAD + 0.1, (n, 12))
    return torque, Motion(position, rng.normal(0.0, 15.0, (n, 12)), 0.005)


class Fields(dict):
    joint_dofs = np.arange(6, 18)


def outcome(effect: Effect) -> np.ndarray:
    """What an effect makes of a fixed input, by its hook, through its own formula."""
    torque, motion = random_joints()
    if isinstance(effect, TorqueEffect):
        effect = effect.arrays_like(torque)
        return effect.apply(torque, motion, effect.start(torque), effect.mask)[0]
    if effect.hook is Hook.MODEL:
        fields = Fields(
            dof_frictionloss=np.zeros((3, 18)), dof_armature=np.zeros((3, 18)), dof_damping=np.zeros((3, 18))
        )
        effect.edit(fields)
        return np.concatenate([fields[k] for k in sorted(fields)])
    return effect.arrival_s(np.linspace(0.0, 1.0, 5))


NULL_INPUT = {
    Hook.TORQUE: lambda: random_joints()[0],
    Hook.MODEL: lambda: np.zeros((9, 18)),
    Hook.COMMAND: lambda: np.linspace(0.0, 1.0, 5),
}


@pytest.mark.parametrize("cls", BUILT_IN.values(), ids=BUILT_IN)
def test_a_null_effect_changes_no_bit(cls: type[Effect]):
    assert cls().is_null
    np.testing.assert_array_equal(outcome(cls()), NULL_INPUT[cls.hook]())


@pytest.mark.parametrize(
    ("effect", "parameter"),
    [(PAPER_CURVE, p.name) for p in TorqueSpeedCurve.parameters()]
    + [
        (CoulombFriction(level_nm=0.2), "level_nm"),
        (TorqueLimit(limit_nm=45.0), "limit_nm"),
        (PositionTorqueLimit(motor_torque_nm=1.5), "motor_torque_nm"),
        (CommandDelay(delay_s=0.005), "delay_s"),
    ],
    ids=lambda v: v if isinstance(v, str) else v.name,
)
def test_every_parameter_changes_something(effect: Effect, parameter: str):
    smaller = dataclasses.replace(effect, **{parameter: 0.8 * getattr(effect, parameter)})
    assert not np.array_equal(outcome(effect), outcome(smaller))


@pytest.mark.parametrize("cls", BUILT_IN.values(), ids=BUILT_IN)
def test_every_parameter_says_its_bounds_unit_and_source(cls: type[Effect]):
    for p in cls.parameters():
        assert p.low < p.high
        assert p.unit
        assert p.source


def test_an_effect_acts_on_its_joints_only():
    torque, _ = random_joints()
    out = outcome(TorqueLimit(joints=("hl", "fr_kn"), limit_nm=20.0))
    touched = TorqueLimit(joints=("hl", "fr_kn"), limit_nm=20.0).mask
    np.testing.assert_array_equal(out[:, ~touched], torque[:, ~touched])
    np.testing.assert_array_equal(out[:, touched], np.clip(torque[:, touched], -20.0, 20.0))


@pytest.mark.parametrize(
    ("velocity", "high", "low"),
    [
        (0.0, 97.00, -108.79),
        (9.48, 97.00, -108.79),
        ((9.48 + 25.03) / 2, 48.50, -108.79),
        (25.03, 0.0, -108.79),
        (30.0, 0.0, -108.79),
        (-8.32, 97.00, -108.79),
        ((-8.32 - 22.22) / 2, 97.00, -54.395),
        (-40.0, 97.00, 0.0),
    ],
)
def test_torque_speed_curve_by_hand(velocity: float, high: float, low: float):
    v = np.full((1, 12), velocity)
    upper, lower = PAPER_CURVE.arrays_like(v).bounds_nm(v)
    np.testing.assert_allclose(upper, high, atol=1e-9)
    np.testing.assert_allclose(lower, low, atol=1e-9)


def test_one_value_a_simulation():
    torque = np.full((3, 12), 100.0)
    effect = TorqueLimit(limit_nm=np.array([[10.0], [20.0], [30.0]])).arrays_like(torque)
    out, _ = effect.torque(torque, Motion(torque * 0, torque * 0, 0.005), None)
    np.testing.assert_array_equal(out[:, 0], [10.0, 20.0, 30.0])


def test_position_limit_follows_the_table_between_and_beyond_its_rows():
    position = np.concatenate(
        [
            KNEE_TABLE_POSITION_RAD,
            [-3.0, 0.0],
            0.5 * (KNEE_TABLE_POSITION_RAD[1:] + KNEE_TABLE_POSITION_RAD[:-1]),
        ]
    )
    position = np.resize(position, (17, 12))
    torque = np.full_like(position, 1e3)
    effect = PositionTorqueLimit(motor_torque_nm=1.5).arrays_like(torque)
    out, _ = effect.torque(torque, Motion(position, position * 0, 0.005), effect.start(torque))
    np.testing.assert_allclose(out, np.interp(position, KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM), rtol=1e-12)


def test_torch_gives_what_numpy_gives():
    torch = pytest.importorskip("torch")
    torque, motion = random_joints()
    for effect in (PAPER_CURVE, PositionTorqueLimit(motor_torque_nm=1.5), TorqueLimit(limit_nm=45.0)):
        expected = outcome(effect)
        like = torch.as_tensor(torque)
        on_torch = effect.arrays_like(like)
        out, _ = on_torch.apply(
            like,
            Motion(torch.as_tensor(motion.position_rad), torch.as_tensor(motion.velocity_rad_s), 0.005),
            on_torch.start(like),
            torch.as_tensor(effect.mask),
        )
        np.testing.assert_allclose(out.numpy(), expected, rtol=1e-12, atol=1e-12)


def test_delay_shifts_the_arrival():
    np.testing.assert_array_equal(CommandDelay(delay_s=0.005).arrival_s(np.array([0.0, 0.02])), [0.005, 0.025])


@pytest.mark.parametrize(
    ("name", "fields", "message"),
    [
        (
            "torque_limit",
            {"limit_nm": -3},
            r"torque_limit.limit_nm = -3; allowed: 1 to 500 N·m or inf for none",
        ),
        ("torque_limit", {"limit": 3}, r"unknown key 'limit'; allowed: joints, limit_nm"),
        ("torque_limit", {"limit_nm": "4"}, r"limit_nm = '4' is no number"),
        ("torque_limit", {"limit_nm": math.nan}, r"limit_nm is not a number"),
        ("torque_limit", {"limit_nm": 40, "joints": ["fl_foot"]}, r"'fl_foot' is no joint"),
        ("torque_speed_curve", {"speed_max_rad_s": 20}, r"set without torque_max_nm"),
        (
            "torque_speed_curve",
            {"torque_max_nm": 90, "speed_max_rad_s": 20, "intersect_max_rad_s": 21},
            r"intersect_max_rad_s = 21.0 lies beyond speed_max_rad_s = 20.0",
        ),
        ("torque_lmit", {}, r"'torque_lmit' is unknown; allowed: .*torque_limit"),
        ("json:dumps", {}, r"a subclass of"),
        ("no.such.module:Thing", {}, r"cannot be loaded"),
    ],
)
def test_bad_effects_are_refused_in_words(name: str, fields: dict, message: str):
    with pytest.raises(BadInputError, match=message):
        make_effect(name, fields)


def test_an_effect_of_ones_own_is_found_by_module_and_class():
    assert effect_class("spot_model.effects.torque_limit:TorqueLimit") is TorqueLimit
