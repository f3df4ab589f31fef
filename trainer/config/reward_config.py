"""Weights of the rewards and the numbers inside their formulas."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import entry_points
from typing import Final

from pydantic import ConfigDict, Field, model_validator

from spot_model.io.settings import Settings

ENTRY_POINT_GROUP: Final = "spot_rl.rewards"
"""Where installed packages name their rewards."""


def check_reward_names(names: Iterable[str]) -> None:
    """Check that each name is ours, installed, or ``module:function``; raises ValueError."""
    known = [*RewardWeights.model_fields, *(entry.name for entry in entry_points(group=ENTRY_POINT_GROUP))]
    for name in names:
        if name not in known and ":" not in name:
            allowed = f"{', '.join(known)}, or module:function for one of your own"
            raise ValueError(f"no reward is called {name}; allowed: {allowed}")


class RewardWeights(Settings):
    """One weight a reward term; each term is weighted, multiplied by the policy period and added up.

    A reward of one's own has the key ``module:function``, or the name under which it is installed in the entry-point
    group ``spot_rl.rewards``; see :func:`trainer.task.reward_terms.reward_term`.

    Source: Isaac Lab's released Spot task (BSD-3-Clause) for the defaults; the paper names foot impact and foot
    distance without weights, so those two are this project's choice.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, float] = Field(init=False)

    linear_velocity: float = 5.0
    yaw_rate: float = 5.0
    air_time: float = 5.0
    gait: float = 10.0
    trot: float = 0.0
    """Not of the paper: the gait term compares times, so that short strides make a hop look like a trot."""
    short_swing: float = 0.0
    """Not of the paper."""
    long_phase: float = 0.0
    """Not of the paper: a price on phases that air_time merely ceases to pay, which keeps strides from growing long."""
    foot_clearance: float = 0.5
    action_smoothness: float = -1.0
    air_time_variance: float = -1.0
    uneven_duty: float = 0.0
    """Not of the paper: phases that differ by less than a policy period are invisible to air_time_variance."""
    fall: float = 0.0
    """Not of the paper. As all weights it is multiplied by the period: -1000 costs 20 a fall."""
    base_motion: float = -2.0
    orientation: float = -3.0
    foot_slip: float = -0.5
    foot_impact: float = -0.5
    foot_distance: float = -2.0
    joint_acceleration: float = -1.0e-4
    joint_velocity: float = -1.0e-2
    joint_position: float = -0.7
    joint_torque: float = -5.0e-4
    power: float = 0.0
    """Not of the paper."""

    @model_validator(mode="after")
    def _known(self) -> RewardWeights:
        check_reward_names(self.model_extra or {})
        return self

    def by_name(self) -> dict[str, float]:
        """Every weight, those of one's own rewards last."""
        return {name: float(weight) for name, weight in self.model_dump().items()}


class RewardShape(Settings):
    """The numbers inside the reward formulas; see :mod:`trainer.task.rewards`."""

    linear_velocity_scale_m_s: float = Field(default=1.0, gt=0.0)
    """Velocity error at which *linear_velocity* falls to 1/e."""
    linear_velocity_ramp_from_m_s: float = Field(default=1.0, ge=0.0)
    """Commanded speed from which *linear_velocity* is worth more."""
    linear_velocity_ramp_s_per_m: float = Field(default=0.5, ge=0.0)
    """How much more, per m/s."""
    yaw_rate_scale_rad_s: float = Field(default=2.0, gt=0.0)
    """Error at which *yaw_rate* falls to 1/e."""
    swing_time_s: float = Field(default=0.3, gt=0.0)
    """Longest swing or stance that *air_time* rewards."""
    moving_above_m_s: float = Field(default=0.5, ge=0.0)
    """A robot that is commanded to stand counts as moving above this speed."""
    standing_command_below: float = Field(default=0.05, ge=0.0)
    """A command whose norm over V_x, V_y (m/s), ω_z (rad/s) is below this means: stand."""
    gait_scale_s2: float = Field(default=0.1, gt=0.0)
    """Scale of the squared time differences in *gait*."""
    gait_largest_error_s: float = Field(default=0.2, gt=0.0)
    """Larger time differences count as this in *gait*."""
    gait_stride_s: float = Field(default=0.0, ge=0.0)
    """*gait* scales its times to strides of this length; 0: seconds, as in the paper."""
    flight_allowed_m_s: tuple[float, float] = (1.0, 2.0)
    """Commanded speeds from which flight starts to count as part of a trot, and from which it counts fully."""
    clearance_height_m: float = Field(default=0.1, gt=0.0)
    """Desired height of a swinging foot."""
    clearance_scale_m2: float = Field(default=0.05, gt=0.0)
    """Scale of the squared height error in *foot_clearance*."""
    clearance_speed_factor_s_per_m: float = Field(default=2.0, gt=0.0)
    """Height errors are weighted by tanh(this × horizontal speed of the foot)."""
    variance_cap_s: float = Field(default=0.5, gt=0.0)
    """Longer phases count as this in *air_time_variance*."""
    duty_window_s: float = Field(default=1.0, ge=0.02)
    """Time constant of the mean behind uneven_duty."""
    foot_impact_relief_s_per_m: float = Field(default=0.0, ge=0.0)
    """Touch-down speeds are divided by 1 + this × commanded speed, because fast feet cannot land as softly."""
    foot_distance_m: float = Field(default=0.18, gt=0.0)
    """Horizontal distance below which two feet count as too close."""
    standing_position_factor: float = Field(default=5.0, ge=0.0)
    """Factor of *joint_position* when the robot is commanded to stand."""
