"""Draw docs/reference/effects/NAME.svg: a knee's load and velocity while walking, without an effect and with it.

python scripts/draw_effects.py           those that are missing
python scripts/draw_effects.py NAME...   these anew
"""

from __future__ import annotations

import sys

import numpy as np
from reference.effects import PICTURES

from spot_log.page.picture import standing
from spot_log.page.sections import Chart, Series
from spot_log.read.run import Run
from spot_model.effects.registry import BUILT_IN, make_effect
from spot_model.io.model_file import load_model
from spot_model.policy.policy import load_policy
from spot_model.robot import facts
from trainer.signals.policy_ticks import Script
from trainer.simulate.recorded_runs import UsualNoise, simulate_scripts
from trainer.simulate.rollout import StartState

JOINT = facts.JOINT_NAMES.index("fl_kn")
SECONDS, SHOWN_S = 1.8, 0.6
SIZES = {
    "action_scale": {"scale": 1.2},
    "armature": {"inertia_kg_m2": 0.08},
    "backlash": {"gap_rad": 0.03, "rotor_inertia_kg_m2": 0.02},
    "body_inertia": {"scale": 2.0},
    "bus_sag": {"resistance_ohm": 0.3},
    "com_offset": {"x_m": 0.06},
    "command_delay": {"delay_s": 0.02},
    "command_drop": {"probability": 0.3},
    "command_jitter": {"mean_s": 0.01},
    "contact_delay": {"delay_s": 0.05},
    "coulomb_friction": {"level_nm": 3.0},
    "default_pose": {"offset_rad": 0.08},
    "encoder_offset": {"offset_rad": 0.06},
    "foot_drag": {"drag_n_s_per_m": 30.0, "height_m": 0.2},
    "foot_radius": {"change_m": 0.015},
    "ground_compliance": {"time_constant_s": 0.05},
    "ground_friction": {"scale": 0.3},
    "ground_slope": {"rise_x_rad": 0.2},
    "imu_tilt": {"pitch_rad": 0.1},
    "joint_compliance": {"compliance_rad_per_nm": 0.002},
    "leg_mass": {"scale": 1.8},
    "leg_odometry": {"time_s": 0.15},
    "load_filter": {"time_constant_s": 0.015},
    "load_friction": {"share": 0.25},
    "load_sensor_gain": {"gain": 1.3},
    "payload_mass": {"mass_kg": 10.0},
    "position_torque_limit": {"motor_torque_nm": 0.5},
    "power_limit": {"power_w": 200.0},
    "sensor_noise": {"velocity_rad_s": 1.0},
    "stribeck_friction": {"level_nm": 5.0, "speed_rad_s": 0.8},
    "thermal_derating": {"loss_per_k": 0.01, "heating_k_per_nm2_s": 0.05},
    "torque_bandwidth": {"time_constant_s": 0.01},
    "torque_delay": {"delay_s": 0.015},
    "torque_gain": {"gain": 0.7},
    "torque_limit": {"limit_nm": 30.0},
    "torque_offset": {"offset_nm": 8.0},
    "torque_ripple": {"amplitude_nm": 5.0, "cycles_per_rad": 6.0},
    "velocity_estimate": {"scale": 0.8},
    "velocity_filter": {"time_constant_s": 0.01},
    "viscous_friction": {"damping_nm_s_per_rad": 1.5},
}
"""Larger than on a robot, so that they can be seen."""


def main() -> None:
    chosen = sys.argv[1:] or [name for name in BUILT_IN if not (PICTURES / f"{name}.svg").is_file()]
    PICTURES.mkdir(exist_ok=True)
    if not chosen:
        print(f"each of {len(BUILT_IN)} effects has its picture; name those that are to be drawn anew")
        return
    plain = walk()
    for name in chosen:
        try:
            drawn = walk(name)
        except Exception as error:  # noqa: BLE001 - one effect that cannot be drawn spares the others
            print(f"{name}: {error}", file=sys.stderr)
            continue
        (PICTURES / f"{name}.svg").write_text(picture(name, plain, drawn) + "\n", encoding="utf-8")


def walk(name: str = "") -> Run:
    """A second of walking from the default pose, with one more effect."""
    model = load_model("paper_identified")
    if name:
        sizes = SIZES.get(name) or {p.name: 0.5 * (p.null + p.high) for p in BUILT_IN[name].parameters()}
        joints = ["knees"] if BUILT_IN[name].hook.value in ("torque", "sensor") else ["all"]
        model = model.with_effects(make_effect(name, {"joints": joints, **sizes}))
    level, still = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
    position, none = np.array(facts.DEFAULT_POSITION_RAD), np.zeros(12)
    start = StartState(position, none, level, still, still, none.astype(np.float32))
    script = Script("walk", 0, start, np.tile([1.0, 0.0, 0.0], (round(SECONDS * 50), 1)))
    noise = UsualNoise(0.0, 0.0, 0.0, 0.0, 0.0)
    rng, policy = np.random.default_rng(0), load_policy(PICTURES.parents[2] / "policies/walk.onnx")
    return simulate_scripts(model, policy, [script], rng, noise)[0]


def picture(name: str, plain: Run, drawn: Run) -> str:
    """Load and velocity over the last moments, side by side."""
    charts = []
    for signal, title in (("load_nm", "load, N·m"), ("velocity_rad_s", "velocity, rad/s")):
        lines = []
        for run, colour in ((plain, "#8fa0ad"), (drawn, "#c8402f")):
            time_s = (run.states.robot_stamp_ns - run.states.robot_stamp_ns[0]) * 1e-9 - (SECONDS - SHOWN_S)
            rows = time_s >= 0.0
            lines.append(Series(colour, time_s[rows], getattr(run.states, signal)[rows, JOINT]))
        charts.append(standing(Chart(lines, title, x_unit=" s", height=104), 370))
    left, right = charts
    size = 'xmlns="http://www.w3.org/2000/svg" width="740" height="160" role="img"'
    label = f"{name}: load and velocity of a knee, without the effect and with it"
    return f'<svg {size} aria-label="{label}">{left}<svg x="370">{right}</svg></svg>'


if __name__ == "__main__":
    main()
