"""The gait measure, on contact patterns of every gait made from phases and duty factors."""

from __future__ import annotations

import numpy as np
import pytest

from spot_model.robot.gait import measure_gait, name_of, without_chatter

# Touch-downs in strides (fl, fr, hl, hr) and duty factors, as the literature draws them.
GAITS = {
    "trot": ((0.0, 0.5, 0.5, 0.0), 0.55),
    "flying trot": ((0.0, 0.5, 0.5, 0.0), 0.35),
    "pace": ((0.0, 0.5, 0.0, 0.5), 0.5),
    "bound": ((0.0, 0.0, 0.5, 0.5), 0.4),
    "pronk": ((0.0, 0.0, 0.0, 0.0), 0.4),
    "walk": ((0.25, 0.75, 0.0, 0.5), 0.7),  # lateral sequence: hl, fl, hr, fr
    "gallop": ((0.5, 0.7, 0.0, 0.2), 0.3),
}


def pattern(phases, duty, *, stride_hz=2.0, seconds=6.0, rate_hz=200.0, jitter_s=0.0, seed=0):
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * rate_hz)) / rate_hz
    contact = np.zeros((len(time), 4), dtype=bool)
    for leg, phase in enumerate(phases):
        for stride in range(-2, round(seconds * stride_hz) + 2):
            start = (stride + phase) / stride_hz + rng.normal(0.0, jitter_s)
            contact[(time >= start) & (time < start + duty / stride_hz), leg] = True
    return time, contact


@pytest.mark.parametrize("stride_hz", [1.5, 3.0, 5.0])
@pytest.mark.parametrize("name", GAITS)
def test_every_gait_is_named_at_any_stride_frequency(name, stride_hz):
    phases, duty = GAITS[name]
    gait = measure_gait(*pattern(phases, duty, stride_hz=stride_hz))
    assert (gait.name, gait.clarity) == (name, 1.0)
    assert gait.stride_hz == pytest.approx(stride_hz, rel=0.03)
    assert gait.duty == pytest.approx([duty] * 4, abs=0.04)


@pytest.mark.parametrize("name", GAITS)
def test_every_gait_is_named_when_its_touch_downs_scatter(name):
    gait = measure_gait(*pattern(*GAITS[name], jitter_s=0.012))
    assert gait.name == name
    assert gait.clarity > 0.8


def test_agreement_is_the_share_of_time_both_up_or_both_down():
    # Duty 0.6: one diagonal alone for 0.4 of the stride, the other for 0.4, all four for 0.2.
    gait = measure_gait(*pattern((0.0, 0.5, 0.5, 0.0), 0.6, stride_hz=1.0, seconds=10.0))
    assert gait.diagonals_agree == 1.0
    assert gait.agreement["front"] == pytest.approx(0.2, abs=0.01)
    assert gait.others_agree == pytest.approx(0.2, abs=0.01)
    assert gait.flight_share == 0.0
    assert gait.phase == pytest.approx((0.0, -0.5, -0.5, 0.0), abs=0.01)


def test_flight_of_a_trot_is_what_its_duty_factor_leaves():
    assert measure_gait(*pattern((0.0, 0.5, 0.5, 0.0), 0.35)).flight_share == pytest.approx(0.3, abs=0.02)


def test_feet_that_stay_down_stand_and_feet_that_stay_up_are_no_gait():
    time = np.arange(100) * 0.01
    standing = measure_gait(time, np.ones((100, 4), dtype=bool))
    assert (standing.name, standing.clarity, standing.stride_hz) == ("stand", 1.0, 0.0)
    assert measure_gait(time, np.zeros((100, 4), dtype=bool)).name == "none"


def test_feet_that_step_at_random_are_no_gait():
    rng = np.random.default_rng(1)
    held = np.repeat(rng.random((60, 4)) < 0.5, 20, axis=0)
    gait = measure_gait(np.arange(len(held)) / 200.0, held)
    assert gait.name == "none" or gait.clarity < 0.6


def test_a_foot_that_drags_makes_it_no_trot():
    time, contact = pattern((0.0, 0.5, 0.5, 0.0), 0.55)
    contact[:, 3] = True
    assert measure_gait(time, contact).name == "none"


def test_chatter_of_a_contact_is_no_step():
    time, contact = pattern((0.0, 0.5, 0.5, 0.0), 0.55)
    noisy = contact.copy()
    noisy[57::61] ^= True
    assert np.mean(without_chatter(time, noisy) == contact) > 0.995
    assert measure_gait(time, noisy).name == "trot"


def test_stamps_need_not_be_evenly_spaced():
    time, contact = pattern((0.0, 0.5, 0.5, 0.0), 0.6)
    kept = np.sort(np.random.default_rng(2).choice(len(time), len(time) * 2 // 3, replace=False))
    gait = measure_gait(time[kept], contact[kept])
    assert gait.name == "trot"
    assert gait.others_agree == pytest.approx(0.2, abs=0.03)


def test_touch_down_speed_is_that_of_the_sample_before():
    time, contact = pattern((0.0, 0.5, 0.5, 0.0), 0.5)
    descent = np.where(contact, 0.0, 0.7)
    assert measure_gait(time, contact, descent).touchdown_m_s == pytest.approx(0.7)
    assert np.isnan(measure_gait(time, contact).touchdown_m_s)


def test_boundaries_lie_half_way_between_the_textbook_gaits():
    def trot_of(lag):
        return name_of((0.0, 0.5, 0.5 - lag, 0.0 - lag))

    assert [trot_of(lag) for lag in (0.0, 0.12, -0.12, 0.13, 0.25)] == ["trot", "trot", "trot", "walk", "walk"]
    assert name_of((0.25, 0.75, 0.0, 0.5), duty=0.4) == "none"  # four beats need stances of half a stride


@pytest.mark.parametrize(
    ("time", "contact"),
    [([0.0], np.ones((1, 4))), ([0.0, 1.0], np.ones((2, 3))), ([1.0, 0.0], np.ones((2, 4)))],
)
def test_spans_that_say_nothing_are_refused(time, contact):
    with pytest.raises(ValueError, match="rising stamps"):
        measure_gait(time, contact)


def test_a_robot_that_mostly_stands_is_said_to_stand():
    rng = np.random.default_rng(3)
    contact = np.ones((2000, 4), dtype=bool)
    for start in rng.integers(0, 1900, 12):
        contact[start : start + 20, rng.integers(0, 4)] = False
    gait = measure_gait(np.arange(2000) / 200.0, contact)
    assert gait.name == "stand"
    assert gait.sentence() == f"stand ({gait.clarity:.0%} of the time on four feet)"
