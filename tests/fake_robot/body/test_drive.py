"""Leaving effects out where they do nothing changes no bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fake_robot.body.drive import Drive
from fake_robot.scenario.scenario import Scenario
from spot_model.effects.base import Motion, TorqueEffect
from spot_model.effects.drivetrain import TorqueBandwidth
from spot_model.plant.command_channel import ServoCommand
from spot_model.plant.effect_chains import TorqueChain
from spot_model.robot.facts import DEFAULT_POSITION_RAD

EFFECTS = [e for e in Scenario().robot_model.effects if isinstance(e, TorqueEffect)]


def case(seed: int, spread: float) -> tuple[ServoCommand, Motion]:
    rng = np.random.default_rng(seed)
    position = DEFAULT_POSITION_RAD + spread * rng.normal(0.0, 0.3, (1, 12))
    velocity = spread * rng.normal(0.0, 6.0, (1, 12))
    servo = ServoCommand(position + spread * rng.normal(0.0, 0.2, (1, 12)), np.zeros((1, 12)), np.zeros((1, 12)))
    return servo, Motion(position, velocity, 0.0015)


@given(seed=st.integers(0, 10_000), spread=st.floats(0.01, 6.0))
def test_the_drive_gives_what_all_effects_together_give(seed: int, spread: float):
    servo, motion = case(seed, spread)
    expected = TorqueChain(EFFECTS, np.zeros((1, 12))).torque_nm(servo, motion, motion)
    np.testing.assert_array_equal(Drive(EFFECTS).torque_nm(servo, motion, motion), expected)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
@given(seed=st.integers(0, 10_000))
def test_an_effect_is_the_identity_inside_its_idle_box(effect: TorqueEffect, seed: int):
    box = effect.idle_box()
    rng = np.random.default_rng(seed)

    def inside(bounds: tuple[float, float], widest: float) -> np.ndarray:
        low, high = np.clip(bounds, -widest, widest)
        # The bounds themselves are inside, too.
        return np.clip(rng.uniform(low - 0.1 * (high - low), high + 0.1 * (high - low), (1, 12)), low, high)

    torque = inside(box.torque_nm, 500.0)
    motion = Motion(inside(box.position_rad, 3.0), inside(box.velocity_rad_s, 50.0), 0.0015)
    on_arrays = effect.arrays_like(torque)
    changed, _ = on_arrays.torque(torque, motion, on_arrays.start(torque))
    np.testing.assert_array_equal(changed, torque)


def test_effects_outside_their_boxes_are_not_left_out():
    servo, motion = case(1, 6.0)
    plain = TorqueChain([], np.zeros((1, 12))).torque_nm(servo, motion, motion)
    assert not np.array_equal(Drive(EFFECTS).torque_nm(servo, motion, motion), plain)


def test_an_effect_without_a_box_always_acts():
    effects = [*EFFECTS, TorqueBandwidth(time_constant_s=0.01)]
    drive, chain = Drive(effects), TorqueChain(effects, np.zeros((1, 12)))
    for seed in range(5):
        servo, motion = case(seed, 0.1)
        expected = chain.torque_nm(servo, motion, motion)
        np.testing.assert_array_equal(drive.torque_nm(servo, motion, motion), expected)
    assert not np.array_equal(expected, TorqueChain([], np.zeros((1, 12))).torque_nm(servo, motion, motion))
