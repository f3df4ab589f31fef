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
        down=torch.tensor([[0.0, 0.0, -1.0]]),
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


MOVING = torch.tensor([True])


def feet(text: str) -> torch.Tensor:
    """Feet fl, fr, hl, hr by a letter each: d on the ground, u in the air."""
    return torch.tensor([[letter == "d" for letter in text]])


def one_hot(shape: tuple[int, ...], **values: float) -> torch.Tensor:
    """Zeros but for the values at ``i_j``, of one robot."""
    out = torch.zeros(1, *shape)
    for place, value_there in values.items():
        out[(0, *map(int, place.strip("_").split("_")))] = value_there
    return out


def test_every_weight_has_a_term_and_every_term_a_weight() -> None:
    assert set(TERMS) == set(RewardWeights.model_fields)


# Term, what differs from standing still, and the reward worked out by hand.
BY_HAND = [
    # Command 3 m/s, measured 2.5: exp(-0.5), times 1 + 0.5·(3 − 1) = 2.
    ("linear_velocity", {"command": row(3.0, 0.0, 0.0), "linear_vel_m_s": row(2.5, 0.0, 9.0)}, 2.0 * math.exp(-0.5)),
    # Below 1 m/s the factor is 1, whatever the error's direction: 3-4-5 triangle.
    ("linear_velocity", {"command": row(0.3, 0.4, 0.0)}, math.exp(-0.5)),
    ("yaw_rate", {"command": row(0.0, 0.0, 1.0), "angular_vel_rad_s": row(7.0, 7.0, -0.5)}, math.exp(-1.5 / 2.0)),
    # Moving: 0.2 + 0.1, and nothing for phases of 0.3 s and more. Standing: −0.2 + 0.1 − 0.3 (clipped) + 0.3.
    ("air_time", {"air_time_s": row(0.2, 0.0, 0.35, 0.0), "contact_time_s": row(0.0, 0.1, 0.0, 0.3)}, (0.3, -0.1)),
    # Front 0.5, hind 0.4: each 0.05 from the mean of 0.45.
    ("uneven_duty", {"duty": row(0.5, 0.5, 0.4, 0.4)}, (0.1, 0.0)),
    ("uneven_duty", {"duty": row(0.4, 0.4, 0.4, 0.4)}, (0.0, 0.0)),
    ("fall", {"fell": torch.tensor([True])}, 1.0),
    ("fall", {}, 0.0),
    # fl and hr in the air for 0.1 s, fr and hl on the ground for 0.1 s.
    ("gait", {"air_time_s": row(0.1, 0.0, 0.0, 0.1), "contact_time_s": row(0.0, 0.1, 0.1, 0.0)}, (1.0, 0.0)),
    # Pace: fl and hl in the air for 0.1 s. Diagonals are out of step: two pairs, air and contact each 0.1² → 4·0.01.
    # fl–fr and hr–hl are out of step as wanted: 0. fl–hl and fr–hr: air and contact differ by 0.1 → 4·0.01.
    (
        "gait",
        {"air_time_s": row(0.1, 0.0, 0.1, 0.0), "contact_time_s": row(0.0, 0.1, 0.0, 0.1)},
        (math.exp(-0.08 / 0.1), 0.0),
    ),
    # All four feet on the ground for a second: in step, but each of eight comparisons with air is capped at 0.2².
    ("gait", {"contact_time_s": row(1.0, 1.0, 1.0, 1.0)}, (math.exp(-8 * 0.04 / 0.1), 0.0)),
    (
        "foot_clearance",
        {"foot_height_m": row(0.05, 0.0, 0.0, 0.0), "foot_velocity_m_s": one_hot((4, 3), _0_0=0.5)},
        math.exp(-(0.05**2) * math.tanh(2.0 * 0.5) / 0.05),
    ),
    # 0.9 is capped at 0.5: mean 0.2, squares 0.09 + 3·0.01, over three.
    (
        "air_time_variance",
        {"last_air_time_s": row(0.9, 0.1, 0.1, 0.1), "last_contact_time_s": row(0.2, 0.2, 0.2, 0.2)},
        0.12 / 3.0,
    ),
    (
        "base_motion",
        {"linear_vel_m_s": row(9.0, 9.0, 0.5), "angular_vel_rad_s": row(-0.3, 0.2, 9.0)},
        0.8 * 0.25 + 0.2 * 0.5,
    ),
    ("orientation", {"down": row(0.3, -0.4, -0.8)}, 0.5),
    # Of the feet on the ground alone, and of their horizontal speed.
    (
        "foot_slip",
        {
            "foot_velocity_m_s": one_hot((4, 3), _0_0=0.3, _0_1=0.4, _0_2=5.0, _1_0=2.0),
            "contact": feet("dudd"),
        },
        0.5,
    ),
    ("foot_impact", {"touchdown_speed_m_s": row(0.0, 0.7, 0.0, 0.3)}, 1.0),
    ("foot_distance", {}, 0.0),
    (
        "foot_distance",
        {"foot_xy_m": torch.tensor([[[0.3, 0.04], [0.3, -0.04], [-0.3, 0.2], [-0.3, -0.2]]])},
        0.18 - 0.08,
    ),
    ("joint_position", {"position_offset_rad": one_hot((12,), _4=0.5)}, (0.5, 2.5)),
    # Wanted 0.3 s: fl lacks 0.2 s; fr swung long enough; hl swung 0.1 s too, but did not touch down now.
    ("short_swing", {"last_air_time_s": row(0.1, 0.4, 0.1, 0.0), "touched_down": feet("dduu")}, (0.2, 0.0)),
    # Wanted at most 0.3 s: fl has been up for 0.32 s and hr down for 0.5 s; fr is up for 0.3 s, hl down for 0.1 s.
    ("long_phase", {"air_time_s": row(0.32, 0.3, 0.0, 0.0), "contact_time_s": row(0.0, 0.0, 0.1, 0.5)}, (2.0, 0.0)),
    # Work that is done, and not what is braked.
    (
        "power",
        {"torque_nm": one_hot((12,), _0=10.0, _1=10.0), "velocity_rad_s": one_hot((12,), _0=2.0, _1=-5.0)},
        20.0,
    ),
    *(
        (term, {field: one_hot((12,), _2=3.0, _7=-4.0)}, 5.0)
        for term, field in (
            ("action_smoothness", "action"),
            ("joint_acceleration", "acceleration_rad_s2"),
            ("joint_velocity", "velocity_rad_s"),
            ("joint_torque", "torque_nm"),
        )
    ),
]


@pytest.mark.parametrize(("term", "changes", "wanted"), BY_HAND)
def test_a_term_worked_out_by_hand(
    term: str, changes: dict[str, torch.Tensor], wanted: float | tuple[float, float]
) -> None:
    """Where two numbers are wanted: of a robot that moves, and of one that is told to stand."""
    moving, standing = wanted if isinstance(wanted, tuple) else (wanted, wanted)
    assert value(term, **changes, is_moving=MOVING) == pytest.approx(moving, abs=1e-6)
    assert value(term, **changes) == pytest.approx(standing, abs=1e-6)


def test_a_fast_robot_may_land_harder_where_the_config_says_so() -> None:
    fast = moment(touchdown_speed_m_s=row(0.0, 0.7, 0.0, 0.3), command=row(2.4, 3.2, 9.0))
    relieved = RewardShape(foot_impact_relief_s_per_m=0.5)
    assert float(TERMS["foot_impact"](fast, relieved)) == pytest.approx(1 / 3)


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


def test_gait_in_strides_is_blind_to_their_length() -> None:
    # A pronk: all feet in the air for half of a phase. In seconds, short strides are paid nearly in full.
    def pronk(stride_s: float, shape: RewardShape) -> float:
        time, half = torch.full((1, 4), stride_s / 4), torch.full((1, 4), stride_s / 2)
        here = moment(air_time_s=time, last_air_time_s=half, last_contact_time_s=half, is_moving=MOVING)
        return float(TERMS["gait"](here, shape)[0])

    in_strides = RewardShape(gait_stride_s=0.5)
    assert pronk(0.2, SHAPE) > 0.8 > pronk(0.5, SHAPE)
    assert pronk(0.2, in_strides) == pytest.approx(pronk(0.5, in_strides)) == pytest.approx(pronk(0.5, SHAPE))
