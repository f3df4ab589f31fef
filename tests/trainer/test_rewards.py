import dataclasses
import math

import pytest
import torch

from trainer.config.task_config import RewardShape, RewardWeights
from trainer.task.rewards import TERMS, Moment

SHAPE = RewardShape()


def moment(**changes: torch.Tensor) -> Moment:
    """One robot that stands perfectly still, as it was told to."""
    zero3, zero4, zero12 = torch.zeros(1, 3), torch.zeros(1, 4), torch.zeros(1, 12)
    corners = torch.tensor([[[0.3, 0.2], [0.3, -0.2], [-0.3, 0.2], [-0.3, -0.2]]])
    still = Moment(
        command=zero3,
        linear_vel_m_s=zero3,
        angular_vel_rad_s=zero3,
        gravity=torch.tensor([[0.0, 0.0, -1.0]]),
        position_offset_rad=zero12,
        velocity_rad_s=zero12,
        acceleration_rad_s2=zero12,
        torque_nm=zero12,
        action=zero12,
        last_action=zero12,
        foot_height_m=zero4,
        foot_velocity_m_s=torch.zeros(1, 4, 3),
        foot_xy_m=corners,
        contact=torch.ones(1, 4, dtype=torch.bool),
        support=torch.ones(1, 4, dtype=torch.bool),
        touched_down=torch.zeros(1, 4, dtype=torch.bool),
        air_time_s=zero4,
        contact_time_s=zero4,
        last_air_time_s=zero4,
        last_contact_time_s=zero4,
        touchdown_speed_m_s=zero4,
        duty=torch.ones(1, 4),
        fell=torch.tensor([False]),
        is_moving=torch.tensor([False]),
    )
    return dataclasses.replace(still, **changes)


def value(term: str, **changes: torch.Tensor) -> float:
    return float(TERMS[term](moment(**changes), SHAPE)[0])


def row(*values: float) -> torch.Tensor:
    return torch.tensor([list(values)])


def test_every_weight_has_a_term_and_every_term_a_weight() -> None:
    assert set(TERMS) == set(RewardWeights.model_fields)


def test_linear_velocity() -> None:
    # Command 3 m/s, measured 2.5: exp(-0.5), times 1 + 0.5·(3 − 1) = 2.
    got = value("linear_velocity", command=row(3.0, 0.0, 0.0), linear_vel_m_s=row(2.5, 0.0, 9.0))
    assert got == pytest.approx(2.0 * math.exp(-0.5))
    # Below 1 m/s the factor is 1, whatever the error's direction: 3-4-5 triangle.
    got = value("linear_velocity", command=row(0.3, 0.4, 0.0))
    assert got == pytest.approx(math.exp(-0.5))


def test_yaw_rate() -> None:
    got = value("yaw_rate", command=row(0.0, 0.0, 1.0), angular_vel_rad_s=row(7.0, 7.0, -0.5))
    assert got == pytest.approx(math.exp(-1.5 / 2.0))


def test_air_time_rewards_short_phases_when_moving_and_contact_when_standing() -> None:
    times = {"air_time_s": row(0.2, 0.0, 0.35, 0.0), "contact_time_s": row(0.0, 0.1, 0.0, 0.3)}
    # Moving: 0.2 + 0.1, and nothing for phases of 0.3 s and more.
    assert value("air_time", **times, is_moving=torch.tensor([True])) == pytest.approx(0.3)
    # Standing: −0.2 + 0.1 − 0.3 (clipped) + 0.3.
    assert value("air_time", **times) == pytest.approx(-0.1)


def test_uneven_duty_is_the_norm_of_what_differs_from_the_mean() -> None:
    moving = torch.tensor([True])
    # Front 0.5, hind 0.4: each 0.05 from the mean of 0.45.
    assert value("uneven_duty", duty=row(0.5, 0.5, 0.4, 0.4), is_moving=moving) == pytest.approx(0.1)
    assert value("uneven_duty", duty=row(0.4, 0.4, 0.4, 0.4), is_moving=moving) == 0.0
    assert value("uneven_duty", duty=row(0.5, 0.5, 0.4, 0.4)) == 0.0


def test_a_fall_counts_once() -> None:
    assert value("fall", fell=torch.tensor([True])) == 1.0
    assert value("fall") == 0.0


def test_gait_is_one_in_a_perfect_trot_and_zero_when_standing() -> None:
    # fl and hr in the air for 0.1 s, fr and hl on the ground for 0.1 s.
    trot = {"air_time_s": row(0.1, 0.0, 0.0, 0.1), "contact_time_s": row(0.0, 0.1, 0.1, 0.0)}
    assert value("gait", **trot, is_moving=torch.tensor([True])) == pytest.approx(1.0)
    assert value("gait", **trot) == 0.0


def test_gait_counts_each_pair_once_and_caps_errors() -> None:
    # Pace: fl and hl in the air for 0.1 s. Diagonals are out of step: two pairs, air and contact each 0.1² → 4·0.01.
    # fl–fr and hr–hl are out of step as wanted: 0. fl–hl and fr–hr: air and contact differ by 0.1 → 4·0.01.
    pace = {"air_time_s": row(0.1, 0.0, 0.1, 0.0), "contact_time_s": row(0.0, 0.1, 0.0, 0.1)}
    assert value("gait", **pace, is_moving=torch.tensor([True])) == pytest.approx(math.exp(-0.08 / 0.1))
    # All four feet on the ground for a second: in step, but each of eight comparisons with air is capped at 0.2².
    stand = {"contact_time_s": row(1.0, 1.0, 1.0, 1.0)}
    assert value("gait", **stand, is_moving=torch.tensor([True])) == pytest.approx(math.exp(-8 * 0.04 / 0.1))


def test_foot_clearance() -> None:
    velocity = torch.zeros(1, 4, 3)
    velocity[0, 0, 0] = 0.5
    got = value("foot_clearance", foot_height_m=row(0.05, 0.0, 0.0, 0.0), foot_velocity_m_s=velocity)
    assert got == pytest.approx(math.exp(-(0.05**2) * math.tanh(2.0 * 0.5) / 0.05))


def test_air_time_variance_uses_the_unbiased_variance_and_the_cap() -> None:
    got = value(
        "air_time_variance", last_air_time_s=row(0.9, 0.1, 0.1, 0.1), last_contact_time_s=row(0.2, 0.2, 0.2, 0.2)
    )
    # 0.9 is capped at 0.5: mean 0.2, squares 0.09 + 3·0.01, over three.
    assert got == pytest.approx(0.12 / 3.0)


def test_base_motion_and_orientation() -> None:
    got = value("base_motion", linear_vel_m_s=row(9.0, 9.0, 0.5), angular_vel_rad_s=row(-0.3, 0.2, 9.0))
    assert got == pytest.approx(0.8 * 0.25 + 0.2 * 0.5)
    assert value("orientation", gravity=row(0.3, -0.4, -0.8)) == pytest.approx(0.5)


def test_foot_slip_counts_only_feet_on_the_ground() -> None:
    velocity = torch.zeros(1, 4, 3)
    velocity[0, 0] = torch.tensor([0.3, 0.4, 5.0])
    velocity[0, 1, 0] = 2.0
    contact = torch.tensor([[True, False, True, True]])
    assert value("foot_slip", foot_velocity_m_s=velocity, contact=contact) == pytest.approx(0.5)


def test_foot_impact_and_distance() -> None:
    landing = row(0.0, 0.7, 0.0, 0.3)
    assert value("foot_impact", touchdown_speed_m_s=landing) == pytest.approx(1.0)
    relieved = RewardShape(foot_impact_relief_s_per_m=0.5)
    fast = moment(touchdown_speed_m_s=landing, command=row(2.4, 3.2, 9.0))
    assert float(TERMS["foot_impact"](fast, relieved)) == pytest.approx(1 / 3)
    assert value("foot_distance") == 0.0
    close = torch.tensor([[[0.3, 0.04], [0.3, -0.04], [-0.3, 0.2], [-0.3, -0.2]]])
    assert value("foot_distance", foot_xy_m=close) == pytest.approx(0.18 - 0.08)


@pytest.mark.parametrize(
    ("term", "field", "size"),
    [
        ("action_smoothness", "action", 12),
        ("joint_acceleration", "acceleration_rad_s2", 12),
        ("joint_velocity", "velocity_rad_s", 12),
        ("joint_torque", "torque_nm", 12),
    ],
)
def test_norms(term: str, field: str, size: int) -> None:
    vector = torch.zeros(1, size)
    vector[0, 2], vector[0, 7] = 3.0, -4.0
    assert value(term) == 0.0
    assert value(term, **{field: vector}) == pytest.approx(5.0)


def test_joint_position_weighs_more_when_standing() -> None:
    offset = torch.zeros(1, 12)
    offset[0, 4] = 0.5
    assert value("joint_position", position_offset_rad=offset) == pytest.approx(2.5)
    got = value("joint_position", position_offset_rad=offset, is_moving=torch.tensor([True]))
    assert got == pytest.approx(0.5)


MOVING = torch.tensor([True])


def feet(text: str) -> torch.Tensor:
    """Feet fl, fr, hl, hr by a letter each: d on the ground, u in the air."""
    return torch.tensor([[letter == "d" for letter in text]])


@pytest.mark.parametrize(
    ("down", "worth"),
    [("duud", 1.0), ("uddu", 1.0)]
    + [(text, 0.25) for text in ("duuu", "uudu", "dddu", "uddd")]
    + [(text, 0.0) for text in ("dddd", "uuuu", "dduu", "uudd", "dudu", "udud")],
)
def test_trot_pays_one_diagonal_alone(down: str, worth: float) -> None:
    here = {"support": feet(down), "contact": feet(down), "command": row(3.0, 0.0, 0.0)}
    assert value("trot", **here, is_moving=MOVING) == worth
    assert value("trot", **here) == 0.0  # told to stand


@pytest.mark.parametrize(("speed", "worth"), [(0.5, 0.0), (1.0, 0.0), (1.5, 0.5), (2.0, 1.0), (5.0, 1.0)])
def test_trot_counts_the_last_support_in_flight_as_far_as_the_speed_allows_flight(speed: float, worth: float) -> None:
    got = value("trot", support=feet("duud"), contact=feet("uuuu"), command=row(speed, 0.0, 0.0), is_moving=MOVING)
    assert got == pytest.approx(worth)


def test_short_swing_is_what_lacks_at_touch_down() -> None:
    # Wanted 0.3 s: fl lacks 0.2 s; fr swung long enough; hl swung 0.1 s too, but did not touch down now.
    times = {"last_air_time_s": row(0.1, 0.4, 0.1, 0.0), "touched_down": feet("dduu")}
    assert value("short_swing", **times, is_moving=MOVING) == pytest.approx(0.2)


def test_long_phase_counts_the_feet_that_are_late() -> None:
    # Wanted at most 0.3 s: fl has been up for 0.32 s and hr down for 0.5 s; fr is up for 0.3 s, hl down for 0.1 s.
    times = {"air_time_s": row(0.32, 0.3, 0.0, 0.0), "contact_time_s": row(0.0, 0.0, 0.1, 0.5)}
    assert value("long_phase", **times, is_moving=MOVING) == 2.0
    assert value("long_phase", **times, is_moving=~MOVING) == 0.0


def test_power_counts_work_that_is_done_alone() -> None:
    torque, rate = torch.zeros(1, 12), torch.zeros(1, 12)
    torque[0, :2], rate[0, :2] = torch.tensor([10.0, 10.0]), torch.tensor([2.0, -5.0])
    assert value("power", torque_nm=torque, velocity_rad_s=rate) == pytest.approx(20.0)


def test_gait_in_strides_is_blind_to_their_length() -> None:
    # A pronk: all feet in the air for half of a phase. In seconds, short strides are paid nearly in full.
    def pronk(stride_s: float, shape: RewardShape) -> float:
        time, half = torch.full((1, 4), stride_s / 4), torch.full((1, 4), stride_s / 2)
        here = moment(air_time_s=time, last_air_time_s=half, last_contact_time_s=half, is_moving=MOVING)
        return float(TERMS["gait"](here, shape)[0])

    in_strides = RewardShape(gait_stride_s=0.5)
    assert pronk(0.2, SHAPE) > 0.8 > pronk(0.5, SHAPE)
    assert pronk(0.2, in_strides) == pytest.approx(pronk(0.5, in_strides)) == pytest.approx(pronk(0.5, SHAPE))
