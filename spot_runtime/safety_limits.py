"""The bounds of the safety core, as data: each a key of the configuration, with its unit in its name."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from spot_model.io.settings import Settings, between, positive


class SafetyLimits(Settings):
    """Bounds of the safety core. Ages and times count in robot time."""

    state_age_warn_s: float = positive(0.015, 1.0, "A warning is logged once for an older state.")
    state_age_damp_s: float = positive(0.040, 1.0, "An older state ends in damping.")
    state_age_stop_s: float = positive(0.200, 5.0, "Age at which sending stops.")
    state_from_future_s: float = positive(
        0.050, 5.0, "A state stamped further in the future means that a clock jumped."
    )
    rejected_states: int = between(10, 1, 1000, "Duplicated or back-dated states in a row.")
    frozen_s: float = positive(0.040, 5.0, "Joint values identical for this long.")
    quaternion_norm_error: float = positive(0.05, 1.0, "How far the length of the attitude's quaternion may be from 1.")
    tilt_rad: float = positive(0.785398, 3.2, "Between the body's z axis and the vertical.")
    body_height_m: float = between(0.25, 0.0, 0.6, "Body over its lowest foot's sole; a lower body has collapsed.")
    body_velocity_m_s: float = positive(10.0, 100.0, "Measured; 1.5 times that of the fastest gait.")
    body_turn_rate_rad_s: float = positive(20.0, 100.0, "Measured; about three turns per second.")
    load_nm: float = positive(400.0, 5000.0, "Measured, any joint: more than three times the knee's limit.")
    joint_velocity_rad_s: float = positive(40.0, 100.0, "Measured, any joint.")
    joint_position_margin_rad: float = between(0.25, 0.0, 1.0, "A joint position this far beyond its stop is rejected.")
    signals: Literal["stop", "warn"] = Field(
        default="stop", description="Reaction to frozen or contradictory signals: stop, or only a warning."
    )
    setpoint_step_rad: float = positive(
        1.5, 10.0, "Largest change of a set-point in a policy period; larger ones are clipped."
    )
    setpoint_speed_rad_s: float = positive(
        75.0, 500.0, "The same as a speed, for policies with a rate other than 50 Hz; three times the speed of a knee."
    )
    policy_kp_nm_per_rad: float = positive(300.0, 1000.0, "Stiffness that a policy's contract may ask for, any joint.")
    policy_kd_nm_s_per_rad: float = positive(15.0, 50.0, "Damping that a policy's contract may ask for, any joint.")
    policy_action_scale_rad: float = positive(1.0, 2.0, "Set-point per unit of action that a contract may ask for.")
    policy_action_torque_nm: float = positive(
        113.0, 1000.0, "Stiffness times scale: the torque that a unit of action implies."
    )
    policy_rate_hz: tuple[float, float] = Field(
        default=(10.0, 200.0), description="Least and largest rate that a contract may ask for."
    )
    setpoint_step_ticks: int = between(5, 1, 1000, "Clipped steps in a row before the stop.")
    setpoint_overshoot_rad: float = positive(
        1.0, 20.0, "A request this far beyond a stop, and beyond the joint's torque, means a wrong policy."
    )
    setpoint_overshoot_ticks: int = between(5, 1, 1000, "Such requests in a row before the stop.")
    feedforward_nm: float = positive(120.0, 200.0, "Largest feed-forward torque sent.")
    command_echo_s: float = positive(0.150, 5.0, "The robot must confirm a command at least this often.")
    command_loss_share: float = positive(
        0.15, 1.0, "Share of commands lost on the link above which a warning is given."
    )
    skipped_ticks: int = between(10, 1, 1000, "Policy ticks lost within a second.")
    clock_jump_s: float = positive(0.050, 5.0, "A round trip this far from the estimate means that a clock was set.")
    clock_unsynced_warn_s: float = positive(
        10.0, 600.0, "A warning is logged once if time sync is late by more than this."
    )
    battery_percent: float = between(8.0, 0.0, 100.0, "Below this the run ends.")
    motor_temperature_c: float = positive(75.0, 150.0, "Above this the run ends.")
    slow_state_age_s: float = positive(3.0, 60.0, "Age of the last poll at which the run stops.")

    @model_validator(mode="after")
    def _ages_rise(self) -> SafetyLimits:
        if not self.state_age_warn_s < self.state_age_damp_s < self.state_age_stop_s:
            raise ValueError("must rise: state_age_warn_s < state_age_damp_s < state_age_stop_s")
        low_hz, high_hz = self.policy_rate_hz
        if not 1.0 <= low_hz <= high_hz <= 333.0:
            raise ValueError("policy_rate_hz must be two rates, 1 Hz to 333 Hz, the smaller first")
        return self
