"""How a robot can stand: what its joints carry holds its weight, on feet that lie in a plane."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_runtime.control.safety.signals import bounds, check
from spot_runtime.control.safety.signals.legs import Stance, foot_jacobians, is_stance_wrong, stance_of
from spot_runtime.control.safety.signals.window import Window
from spot_runtime.control.safety.signals.wiring import explanations
from tests.spot_runtime.resting_robot import Stand, drawn_stand
from tests.spot_runtime.test_signal_memories import window

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
UP = np.array([0.0, 0.0, 1.0])
WEIGHT_N = 31.60 * 9.81
GOOD = Stance(carried=1.0, pulled=-0.25, sideways=0.0, pressing=-0.25, twist_m=0.0)


def seen(position_rad: Array, load_nm: Array, up: Array = UP) -> Window:
    """A robot that stands so; the vertical is turned into its frame by the shortest rotation."""
    half = np.array([1.0 + up[2], *np.cross(up, UP)])
    return window(position_rad=position_rad, load_nm=load_nm, odom_from_body_wxyz=half / np.linalg.norm(half))


def loads_for(forces: list[list[float]], position_rad: Array = facts.DEFAULT_POSITION_RAD) -> Array:
    """Loads that balance these forces of the ground on the feet, in shares of the weight."""
    _, jacobians = foot_jacobians(position_rad)
    return -WEIGHT_N * np.einsum("lij,li->lj", jacobians, np.array(forces)).ravel()


@pytest.mark.parametrize(
    ("forces", "expected"),
    [
        ([[0.0, 0.0, 0.25]] * 4, GOOD),
        ([[0.0, 0.1, 0.25], [0.0, -0.1, 0.25]] * 2, GOOD._replace(pressing=-0.15)),
        ([[0.03, 0.04, 0.25]] * 4, GOOD._replace(sideways=0.2, pressing=-0.2)),
        ([*[[0.0, 0.0, 0.4]] * 3, [0.0, 0.0, -0.1]], GOOD._replace(carried=1.1, pulled=0.1, pressing=0.0)),
        ([*[[0.0, 0.0, 0.4]] * 3, [0.3, 0.0, 0.1]], Stance(1.3, -0.1, 0.3, 0.2, 0.0)),
        ([*[[0.0, 0.0, 0.4]] * 3, [0.0, 0.3, -0.1]], Stance(1.1, 0.1, 0.3, 0.3, 0.0)),
    ],
)
def test_what_loads_say_of_a_stance(forces: list[list[float]], expected: Stance) -> None:
    found = stance_of(facts.DEFAULT_POSITION_RAD, loads_for(forces), UP)
    np.testing.assert_allclose(found, expected, atol=3e-4)


def test_where_no_load_is_reported_the_feets_plane_alone_is_judged() -> None:
    assert stance_of(facts.DEFAULT_POSITION_RAD, np.zeros(12), UP).is_possible
    assert not stance_of(facts.DEFAULT_POSITION_RAD, np.where(np.arange(12) == 4, 1e-9, 0.0), UP).is_possible
    bent = facts.DEFAULT_POSITION_RAD + np.where(np.isin(np.arange(12), [2, 11]), -0.9, 0.0)
    found = stance_of(bent, np.zeros(12), UP)
    assert found.twist_m > bounds.TWIST_M
    assert found == GOOD._replace(pressing=0.0, twist_m=found.twist_m)


def test_the_twist_is_the_height_of_one_diagonal_over_the_other() -> None:
    """The front-left foot 0.2 m higher, against a body that leans, as on a step."""
    stand = drawn_stand(np.random.default_rng(0), step_m=0.0)
    feet_m, _ = foot_jacobians(stand.position_rad)
    for leg, side in enumerate((1.0, -1.0, -1.0, 1.0)):
        knee = stand.position_rad + np.where(np.arange(12) == 3 * leg + 2, -0.3, 0.0)
        raised_m, _ = foot_jacobians(knee)
        expected = side * (raised_m[leg, 2] - feet_m[leg, 2])
        assert stance_of(knee, stand.load_nm, UP).twist_m == pytest.approx(expected)
    leaning = np.array([0.1, -0.2, 1.0]) / np.linalg.norm([0.1, -0.2, 1.0])
    _, _, _, _, twist_m = stance_of(facts.DEFAULT_POSITION_RAD, stand.load_nm, leaning)
    assert twist_m == pytest.approx(0.0, abs=2e-3)


BOUNDS = {
    "carried": ((bounds.CARRIED_LEAST, -9.0), (bounds.CARRIED_MOST, 9.0)),
    "pulled": ((bounds.PULL_SHARE, 9.0),),
    "sideways": ((bounds.NET_SIDEWAYS_SHARE, 9.0),),
    "pressing": ((bounds.FOOT_ERROR_SHARE, 9.0),),
    "twist_m": ((bounds.TWIST_M, 9.0), (-bounds.TWIST_M, -9.0)),
}


@pytest.mark.parametrize("name", BOUNDS)
def test_a_stance_at_its_bound_is_possible_and_one_beyond_is_not(name: str) -> None:
    for bound, beyond in BOUNDS[name]:
        assert GOOD._replace(**{name: bound}).is_possible
        assert not GOOD._replace(**{name: float(np.nextafter(bound, beyond))}).is_possible


@pytest.mark.parametrize(("share", "is_wrong"), [(0.83, False), (0.99, False), (1.55, False), (1.65, True)])
def test_feet_may_press_apart_by_all_that_rubber_holds_and_by_what_loads_err(share: float, is_wrong: bool) -> None:
    """Feet pressed apart by up to 0.83 of what each carries, as another server's stand does."""
    forces = [[0.0, side * share * 0.25, 0.25] for side in (1.0, -1.0, 1.0, -1.0)]
    assert is_stance_wrong(seen(facts.DEFAULT_POSITION_RAD, loads_for(forces))) is is_wrong


GROUNDS: dict[str, dict[str, Any]] = {
    "flat": {},
    "slope": {"slope_rad": np.radians(15.0)},
    "steep slope": {"slope_rad": np.radians(22.0)},
    "payload": {"payload_kg": 14.0},
    "payload of its own weight": {"payload_kg": 31.6},
    "a foot on a step": {"step_m": 0.2},
    "all of it": {"slope_rad": np.radians(10.0), "payload_kg": 10.0, "step_m": 0.1},
}


def measured(stand: Stand, rng: np.random.Generator) -> Array:
    """Loads that motors and sensors make of it: 10 % of each, and 5 N·m of offset and friction."""
    return stand.load_nm * (1.0 + rng.uniform(-0.1, 0.1, 12)) + rng.uniform(-5.0, 5.0, 12)


@pytest.mark.parametrize("ground", GROUNDS)
def test_a_robot_that_stands_is_believed(ground: str) -> None:
    rng = np.random.default_rng(2)
    for _ in range(15):
        stand = drawn_stand(rng, **GROUNDS[ground])
        assert not is_stance_wrong(seen(stand.position_rad, measured(stand, rng), stand.up))


def mirrored(*joints: int) -> Callable[[Array], Array]:
    signs = np.where(np.isin(np.arange(12), joints), -1.0, 1.0)
    return lambda values: values * signs


def exchanged(a: int, b: int) -> Callable[[Array], Array]:
    order = np.arange(12)
    order[a], order[b] = b, a
    return lambda values: values[order]


WRONG = {
    "fl_hy mirrored": mirrored(1),
    "hr_hy mirrored": mirrored(10),
    "fl_hy, fr_hy, hl_hy, hr_hy mirrored": mirrored(1, 4, 7, 10),
    "fl_kn mirrored": mirrored(2),
    "fl_kn, fr_kn, hl_kn, hr_kn mirrored": mirrored(2, 5, 8, 11),
    "fl_hx and fl_kn exchanged": exchanged(0, 2),
    "hl_hx and hl_kn exchanged": exchanged(6, 8),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_joint_that_is_mirrored_or_exchanged_is_named(name: str) -> None:
    """The names are those of errors after which the stance would be possible; the true one is among them."""
    rng = np.random.default_rng(3)
    for _ in range(5):
        stand = drawn_stand(rng)
        load_nm = measured(stand, rng)
        wrong = seen(WRONG[name](stand.position_rad), load_nm)
        assert is_stance_wrong(wrong)
        assert name in explanations(wrong)


@pytest.mark.parametrize("name", ["fl_hx and fl_kn exchanged", "fl_hy, fr_hy, hl_hy, hr_hy mirrored"])
def test_a_robot_that_cannot_stand_so_is_doubted_within_02_s_and_only_while_it_should_stand(name: str) -> None:
    stand = drawn_stand(np.random.default_rng(5))
    wrong = seen(WRONG[name](stand.position_rad), stand.load_nm).last
    states = [replace(wrong, robot_stamp_ns=wrong.robot_stamp_ns + 3_000_000 * i) for i in range(80)]
    for situation, is_told in ((check.Situation(is_standing=True), True), (check.Situation(), False)):
        memory, doubts = check.check_signals(check.SignalMemory(), states, situation)
        told = [doubt.stop.detail for doubt in doubts if "weight of a robot that stands" in doubt.stop.detail]
        assert bool(told) is is_told
        assert (memory.wrong_stances >= bounds.REST_WINDOWS) is is_told
        assert all(f"unless {name}" in words or f"or {name}" in words for words in told)
        assert is_told == bool(memory.explanations)


def test_loads_of_the_wrong_sign_or_unit_are_no_stance_and_nothing_explains_them() -> None:
    stand = drawn_stand(np.random.default_rng(6))
    for factor in (-1.0, 0.1, 10.0):
        wrong = seen(stand.position_rad, factor * stand.load_nm)
        assert is_stance_wrong(wrong)
    assert explanations(seen(stand.position_rad, 10.0 * stand.load_nm)) == ()


def test_an_error_beyond_a_joints_stop_explains_nothing() -> None:
    stand = drawn_stand(np.random.default_rng(7))
    wrong = seen(mirrored(1)(stand.position_rad), stand.load_nm)
    # A knee bends one way only.
    assert not any("kn mirrored" in words for words in explanations(wrong))
