"""The bounds of the safety core, as data: each a key of the configuration, with its unit in its name."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator


class SafetyLimits(BaseModel):
    """Bounds of the safety core. Ages and times count in robot time."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    state_age_warn_s: float = Field(
        default=0.015, gt=0.0, le=1.0, description="A warning is logged once for an older state."
    )
    state_age_damp_s: float = Field(default=0.040, gt=0.0, le=1.0, description="An older state ends in damping.")
    state_age_stop_s: float = Field(default=0.200, gt=0.0, le=5.0, description="Age at which sending stops.")
    state_from_future_s: float = Field(
        default=0.050, gt=0.0, le=5.0, description="A state stamped further in the future means that a clock jumped."
    )
    rejected_states: int = Field(default=10, ge=1, le=1000, description="Duplicated or back-dated states in a row.")
    frozen_s: float = Field(default=0.040, gt=0.0, le=5.0, description="Joint values identical for this long.")
    quaternion_norm_error: float = Field(
        default=0.05, gt=0.0, le=1.0, description="How far the length of the attitude's quaternion may be from 1."
    )
    tilt_rad: float = Field(default=0.785398, gt=0.0, le=3.2, description="Between the body's z axis and the vertical.")
    body_height_m: float = Field(
        default=0.25, ge=0.0, le=0.6, description="Body over its lowest foot's sole; a lower body has collapsed."
    )
    body_velocity_m_s: float = Field(
        default=10.0, gt=0.0, le=100.0, description="Measured; 1.5 times that of the fastest gait."
    )
    body_turn_rate_rad_s: float = Field(
        default=20.0, gt=0.0, le=100.0, description="Measured; about three turns per second."
    )
    load_nm: float = Field(
        default=400.0, gt=0.0, le=5000.0, description="Measured, any joint: more than three times the knee's limit."
    )
    joint_velocity_rad_s: float = Field(default=40.0, gt=0.0, le=100.0, description="Measured, any joint.")
    joint_position_margin_rad: float = Field(
        default=0.25, ge=0.0, le=1.0, description="A joint position this far beyond its stop is rejected."
    )
    signals: Literal["stop", "warn"] = Field(
        default="stop", description="Reaction to frozen or contradictory signals: stop, or only a warning."
    )
    setpoint_step_rad: float = Field(
        default=1.5,
        gt=0.0,
        le=10.0,
        description="Largest change of a set-point in a policy period; larger ones are clipped.",
    )
    setpoint_speed_rad_s: float = Field(
        default=75.0,
        gt=0.0,
        le=500.0,
        description="The same as a speed, for policies with a rate other than 50 Hz; three times the speed of a knee.",
    )
    policy_kp_nm_per_rad: float = Field(
        default=300.0, gt=0.0, le=1000.0, description="Stiffness that a policy's contract may ask for, any joint."
    )
    policy_kd_nm_s_per_rad: float = Field(
        default=15.0, gt=0.0, le=50.0, description="Damping that a policy's contract may ask for, any joint."
    )
    policy_action_scale_rad: float = Field(
        default=1.0, gt=0.0, le=2.0, description="Set-point per unit of action that a contract may ask for."
    )
    policy_action_torque_nm: float = Field(
        default=113.0, gt=0.0, le=1000.0, description="Stiffness times scale: the torque that a unit of action implies."
    )
    policy_rate_hz: tuple[float, float] = Field(
        default=(10.0, 200.0), description="Least and largest rate that a contract may ask for."
    )
    setpoint_step_ticks: int = Field(default=5, ge=1, le=1000, description="Clipped steps in a row before the stop.")
    setpoint_overshoot_rad: float = Field(
        default=1.0,
        gt=0.0,
        le=20.0,
        description="A request this far beyond a stop, and beyond the joint's torque, means a wrong policy.",
    )
    setpoint_overshoot_ticks: int = Field(
        default=5, ge=1, le=1000, description="Such requests in a row before the stop."
    )
    feedforward_nm: float = Field(default=120.0, gt=0.0, le=200.0, description="Largest feed-forward torque sent.")
    command_echo_s: float = Field(
        default=0.150, gt=0.0, le=5.0, description="The robot must confirm a command at least this often."
    )
    command_loss_share: float = Field(
        default=0.15, gt=0.0, le=1.0, description="Share of commands lost on the link above which a warning is given."
    )
    skipped_ticks: int = Field(default=10, ge=1, le=1000, description="Policy ticks lost within a second.")
    clock_jump_s: float = Field(
        default=0.050, gt=0.0, le=5.0, description="A round trip this far from the estimate means that a clock was set."
    )
    clock_unsynced_warn_s: float = Field(
        default=10.0, gt=0.0, le=600.0, description="A warning is logged once if time sync is late by more than this."
    )
    battery_percent: float = Field(default=8.0, ge=0.0, le=100.0, description="Below this the run ends.")
    motor_temperature_c: float = Field(default=75.0, gt=0.0, le=150.0, description="Above this the run ends.")
    slow_state_age_s: float = Field(
        default=3.0, gt=0.0, le=60.0, description="Age of the last poll at which the run stops."
    )

    @model_validator(mode="after")
    def _ages_rise(self) -> SafetyLimits:
        if not self.state_age_warn_s < self.state_age_damp_s < self.state_age_stop_s:
            raise ValueError("must rise: state_age_warn_s < state_age_damp_s < state_age_stop_s")
        low_hz, high_hz = self.policy_rate_hz
        if not 1.0 <= low_hz <= high_hz <= 333.0:
            raise ValueError("policy_rate_hz must be two rates, 1 Hz to 333 Hz, the smaller first")
        return self
