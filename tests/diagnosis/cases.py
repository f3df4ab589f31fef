"""One planted truth an effect, with what its own channels must find: the ladder's middle rung, on the scripted gait."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from diagnosis.channels import Channel, ChannelView, Views
from diagnosis.channels.actuator import actuator_view
from diagnosis.channels.build import build_views
from diagnosis.channels.stack import Stack, stacked
from diagnosis.decision_constants import ERROR_SCALES
from diagnosis.library import JointGroups
from diagnosis.library.registry import LIBRARY
from diagnosis.selection.evidence import Evidence, lay_out
from spot_log.read.run import Run
from spot_model.effects.base import Effect
from spot_model.effects.commands import CommandDelay
from spot_model.io.model_file import RobotModel
from spot_model.robot.mjcf_options import MjcfOptions
from trainer.signals.recording import record

from .planted import Truth, planted_runs

ALL = ("all",)
NOMINAL = RobotModel((CommandDelay(delay_s=0.005),))
"""The planted transport takes 5 ms on average, and the nominal model knows it."""


@dataclass(frozen=True)
class Case:
    """An effect at a place with its values, and relative tolerances of what is found where they are not 15 %."""

    effect: str
    joints: tuple[str, ...]
    values: Mapping[str, float]
    tolerance: Mapping[str, float] = field(default_factory=dict)
    expected: Mapping[str, float] = field(default_factory=dict)
    """Where the found number is not the planted one: a delta against the nominal model."""
    unchecked: tuple[str, ...] = ()
    duration_s: float = 3.0
    runs: int = 2

    @property
    def label(self) -> str:
        """For the test's name."""
        return f"{self.effect}-{'+'.join(self.joints)}"


def _curve(torque_nm: float, no_load_rad_s: float, corner_rad_s: float) -> dict[str, float]:
    return {
        "torque_max_nm": torque_nm,
        "torque_min_nm": -torque_nm,
        "speed_max_rad_s": no_load_rad_s,
        "speed_min_rad_s": -no_load_rad_s,
        "intersect_max_rad_s": corner_rad_s,
        "intersect_min_rad_s": -corner_rad_s,
    }


CORNERS = ("intersect_max_rad_s", "intersect_min_rad_s")
SOFT_GROUND_S = 0.02
PLANTED_CONTACT_S = Truth().mjcf.contact_solref[0]

CASES = (
    Case("coulomb_friction", ("kn",), {"level_nm": 0.6}),
    Case("coulomb_friction", ("fl_hy",), {"level_nm": 0.3}),
    Case("viscous_friction", ALL, {"damping_nm_s_per_rad": 0.2}),
    Case("stribeck_friction", ("hy",), {"level_nm": 0.8, "speed_rad_s": 0.5}, {"level_nm": 0.2, "speed_rad_s": 0.3}),
    Case("load_friction", ("kn",), {"share": 0.1}),
    Case("torque_gain", ("hl_kn",), {"gain": 0.88}, {"gain": 0.02}),
    Case("armature", ("kn",), {"inertia_kg_m2": 0.03}),
    Case("torque_bandwidth", ALL, {"time_constant_s": 0.005}),
    Case("torque_delay", ("kn",), {"delay_s": 0.006}),
    Case("thermal_derating", ("kn",), {"loss_per_k": 0.02}),
    Case("torque_offset", ("hl_hy",), {"offset_nm": 3.0}),
    Case("torque_offset", ("fr_kn",), {"offset_nm": -2.0}),
    Case(
        "torque_ripple",
        ("hy",),
        {"amplitude_nm": 0.8, "cycles_per_rad": 60.0, "phase_rad": 0.5},
        {"cycles_per_rad": 0.01, "phase_rad": 0.3},
    ),
    Case("backlash", ("kn",), {"gap_rad": 0.006}, {"gap_rad": 0.25}),
    Case("torque_limit", ("kn",), {"limit_nm": 50.0}, {"limit_nm": 0.05}),
    Case(
        "torque_speed_curve",
        ("kn",),
        _curve(50.0, 14.0, 5.0),
        {"speed_max_rad_s": 0.25, "speed_min_rad_s": 0.25},
        unchecked=CORNERS,
        duration_s=5.0,  # its fast states are few once rattling ones are left out
    ),
    Case("position_torque_limit", ("kn",), {"motor_torque_nm": 0.65}, {"motor_torque_nm": 0.05}),
    Case("power_limit", ALL, {"power_w": 280.0, "copper_w_per_nm2": 0.02}, {"power_w": 0.05, "copper_w_per_nm2": 0.5}),
    Case(
        "bus_sag",
        ALL,
        {"resistance_ohm": 1.5, "open_voltage_v": 55.0, "back_emf_v_s_per_rad": 2.2, "stall_nm_per_v": 1.09},
        # The scripted gait hardly reaches the speeds at which back-EMF counts.
        {"resistance_ohm": 0.25, "back_emf_v_s_per_rad": 0.5},
        duration_s=2.5,
        runs=1,  # of its four numbers each combination is tried
    ),
    Case("command_delay", ALL, {"delay_s": 0.006}),
    Case("command_jitter", ALL, {"mean_s": 0.004}),
    Case("command_drop", ALL, {"probability": 0.15}, {"probability": 0.3}, duration_s=6.0),
    Case("encoder_offset", ("fl_kn",), {"offset_rad": 0.03}, {"offset_rad": 0.2}),
    Case("encoder_offset", ("hr_hy",), {"offset_rad": -0.02}, {"offset_rad": 0.25}),
    Case("joint_compliance", ("kn",), {"compliance_rad_per_nm": 0.001}),
    Case("load_sensor_gain", ("fr_kn",), {"gain": 1.1, "bias_nm": 0.8}, {"gain": 0.02}),
    Case(
        "sensor_noise",
        ("hy",),
        {"position_rad": 0.0, "velocity_rad_s": 0.1, "load_nm": 1.2},
        {"velocity_rad_s": 0.25, "load_nm": 0.2},
        unchecked=("position_rad",),
    ),
    Case("load_filter", ALL, {"time_constant_s": 0.005}, {"time_constant_s": 0.25}),
    Case("velocity_filter", ("kn",), {"time_constant_s": 0.006}, {"time_constant_s": 0.2}),
    Case(
        "velocity_estimate",
        ALL,
        {"scale": 0.93, "bias_x_m_s": 0.05, "bias_y_m_s": 0.0, "lag_s": 0.02},
        {"scale": 0.02, "bias_x_m_s": 0.3, "lag_s": 0.3},
    ),
    Case(
        "payload_mass",
        ALL,
        {"mass_kg": 3.0, "x_m": 0.1, "y_m": 0.0, "z_m": 0.1},
        {"x_m": 0.25, "z_m": 0.4},
    ),
    Case("com_offset", ALL, {"x_m": 0.03, "y_m": -0.015, "z_m": 0.0}, {"y_m": 0.2}),
    Case("body_inertia", ALL, {"scale": 1.6}, {"scale": 0.07}),
    Case("leg_mass", ("kn",), {"scale": 1.3}, {"scale": 0.06}),
    Case("leg_mass", ("fl_hy",), {"scale": 1.2}, {"scale": 0.04}, unchecked=("down_m",)),
    Case("leg_mass", ("hr_kn",), {"scale": 2.5, "down_m": 0.25}),
    Case("foot_radius", ("fl",), {"change_m": 0.006}, {"change_m": 0.2}),
    Case("ground_friction", ALL, {"scale": 0.3}),
    Case(
        "ground_compliance",
        ALL,
        {"time_constant_s": SOFT_GROUND_S},
        {"time_constant_s": 0.3},
        expected={"time_constant_s": SOFT_GROUND_S + PLANTED_CONTACT_S - MjcfOptions().contact_solref[0]},
        duration_s=4.0,
    ),
    Case("contact_delay", ALL, {"delay_s": 0.03}),
    Case("imu_tilt", ALL, {"roll_rad": 0.02, "pitch_rad": -0.03}),
    Case("ground_slope", ALL, {"rise_x_rad": 0.07, "rise_y_rad": -0.03}),
    Case("foot_drag", ALL, {"drag_n_s_per_m": 8.0, "height_m": 0.08}, unchecked=("height_m",)),
    Case("action_scale", ("kn",), {"scale": 1.2}, {"scale": 1e-3}),
    Case("default_pose", ("hl",), {"offset_rad": 0.05}, {"offset_rad": 1e-3}),
    Case("joint_swap", ("hx",), {"share": 0.5}, {"share": 1e-3}),
)
ABSOLUTE = {"rad": 0.004, "m": 0.01, "m_s": 0.02, "kg": 0.2, "1": 0.02}
"""What a number whose planted value is none may be found as, by the end of its name."""


def drive_evidence(*effects: Effect) -> tuple[Stack, Evidence]:
    """Two planted logs, and the evidence of channel *set-point to load* alone."""
    logs = stacked([record(run) for run in planted_runs(Truth(effects=effects), 2)])
    view = actuator_view(logs, ())
    assert isinstance(view, ChannelView)
    return logs, _laid_out(logs, {view.name: view})


def evidence_over(runs: Sequence[Run], channels: Sequence[Channel] = tuple(Channel)) -> Evidence:
    """The evidence of some channels of logs, each log a fold."""
    logs = stacked([record(run) for run in runs])
    views, _ = build_views(logs, NOMINAL)
    return _laid_out(logs, {name: view for name, view in views.items() if name in channels})


def _laid_out(logs: Stack, views: Views) -> Evidence:
    folds = range(len(logs.recordings))
    robot = JointGroups(logs.joint_names, logs.legs)
    return lay_out(views, robot, folds, [str(k) for k in folds], library=LIBRARY, scales=ERROR_SCALES)
