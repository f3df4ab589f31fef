"""Readings that once went wrong: stops of feet, knocks of a gear, slow ripple, effects too small."""

import numpy as np
import pytest

from diagnosis.channels.contact_events import _crossing
from diagnosis.channels.sensors import _high_squares, _knocks
from diagnosis.library.contact import GroundComplianceEntry
from diagnosis.library.joint_sensing import VelocityFilterEntry
from diagnosis.library.ripple import slow_orders


def test_a_foot_that_rolls_on_is_stopped_as_early_as_one_that_rests() -> None:
    time = np.arange(40.0)
    stopped = -np.exp(-time / 4.0)
    rolling = np.minimum(stopped, -0.06)
    assert _crossing(rolling, -0.25) == pytest.approx(_crossing(stopped, -0.25))
    assert _crossing(stopped, -0.25) == pytest.approx(4.0 * np.log(4.0), abs=0.1)
    assert _crossing(rolling, -0.05) == np.inf


def test_impacts_are_knocks_and_noise_and_steps_are_not() -> None:
    rng = np.random.default_rng(0)
    n, counted = 4000, np.ones((4000, 1), dtype=np.bool_)
    noise, steps = (
        rng.normal(0.0, 0.5, (n, 1)),
        np.cumsum(rng.normal(0.0, 2.0, (n, 1)) * (np.arange(n)[:, None] % 7 == 0), axis=0),
    )
    impacts = rng.normal(0.0, 6.0, (n, 1)) * (rng.random((n, 1)) < 0.1)
    white = np.array([0.25])
    none = np.zeros((n, 1))
    assert _knocks(_high_squares(noise), none, counted, white)[0] < 0.03
    assert _knocks(_high_squares(noise + steps), _high_squares(steps), counted, white)[0] == 0.0
    assert _knocks(_high_squares(noise + impacts), none, counted, white)[0] > 1.0
    assert np.isnan(_knocks(_high_squares(noise), none, counted & False, white)[0])


@pytest.mark.parametrize("order", [9.0, 13.88, 21.51, 27.3])
def test_a_slow_ripple_is_told_by_hips_and_knees_together(order: float) -> None:
    rng = np.random.default_rng(4)
    time = 0.006 * np.arange(4000)[:, None]
    middle = np.tile([0.0, 0.9, -1.8], 4)
    # Each swings through less than a wave and a half, and a rotor's inertia pulls harder than the ripple.
    angle = middle + 0.15 * np.sin(12.0 * time + rng.uniform(0.0, 6.0, 12)) + 0.03 * np.sin(3.0 * time)
    acceleration = np.gradient(np.gradient(angle, 0.006, axis=0), 0.006, axis=0)
    ripple = 1.5 * np.sin(order * angle + 0.7)
    residual = ripple + 0.15 * acceleration + rng.normal(0.0, 0.5, angle.shape)
    sets = np.array([*np.eye(12), np.ones(12)]) > 0.0
    found = slow_orders(angle, residual, acceleration[:, :, None], np.ones(angle.shape, np.bool_), sets)
    # Half an order a round of refinement.
    assert np.abs(np.array(found) - order).min() <= 0.5
    assert len(found) == 6


def test_an_effect_below_its_least_is_not_there() -> None:
    assert not VelocityFilterEntry().is_there(np.array([1e-4, 0.0, 0.5, 0.5]), {})
    assert VelocityFilterEntry().is_there(np.array([4e-3, 0.0, 0.5, 0.5]), {})
    assert not GroundComplianceEntry().is_there(np.array([0.0, 1e-5, 0.0]), {})
