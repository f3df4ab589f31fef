"""A reality: everything about a robot and its surroundings that may be ordinary, drawn from one seeded generator.

The ranges come from data sheets, from what users strap to such robots, and from where they walk, not from the checks
of the runtime.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from fake_robot.scenario.scenario import Scenario
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint
from spot_model.policy.contract import PolicyContract

SECONDS: Final = (10.0, 14.0)
MAX_DELAY_S: Final = 0.02
"""From a state to the command that answers it, both directions together, on average."""

FINE_COUNTS, COARSE_COUNTS = 2**18, 2**14
"""Counts a turn of a joint's encoder, the best and the worst."""


@dataclass(frozen=True)
class Sensors:
    """What the joints' sensors do that a scenario does not say."""

    load_lag_s: float
    """Time constant of the load cells' filter."""
    position_step_rad: float
    velocity_step_rad_s: float
    load_step_nm: float
    velocity_bias_m_s: tuple[float, float, float]
    """Bias of the state estimator's velocity, in odom."""
    turn_rate_bias_rad_s: tuple[float, float, float]


@dataclass(frozen=True)
class Push:
    """A velocity that the body gains in an instant."""

    at_s: float
    forward_m_s: float
    left_m_s: float
    yaw_rad_s: float


@dataclass(frozen=True)
class Walk:
    """What is asked of the robot, and what people do to it meanwhile."""

    commands: VelocitySequence
    nudge: Push | None = None
    """Given again and again, ``at_s`` apart."""


@dataclass(frozen=True)
class Reality:
    """One robot where it walks."""

    scenario: dict[str, Any]
    """Scenario, as in a scenario file."""
    sensors: Sensors
    pushes: tuple[Push, ...]


def draw_reality(rng: np.random.Generator) -> Reality:
    """A robot, its ground and its link."""
    sensors = Sensors(
        load_lag_s=float(rng.uniform(0.0, 0.006)),
        position_step_rad=2.0 * np.pi / float(np.exp(rng.uniform(np.log(COARSE_COUNTS), np.log(FINE_COUNTS)))),
        velocity_step_rad_s=float(_log_uniform(rng, 1e-4, 0.02)),
        load_step_nm=float(_log_uniform(rng, 0.005, 0.25)),
        velocity_bias_m_s=tuple(rng.normal(0.0, 0.02, 3).tolist()),
        turn_rate_bias_rad_s=tuple(rng.normal(0.0, 0.01, 3).tolist()),
    )
    pushes = tuple(
        Push(float(rng.uniform(1.0, 10.0)), *(float(v) for v in rng.normal(0.0, (0.4, 0.4, 0.6))))
        for _ in range(int(rng.integers(0, 4)))
    )
    data = {
        "seed": int(rng.integers(2**31)),
        "time_mode": "lock_step",
        "model": {"effects": [*Scenario().model_dump(mode="json")["model"]["effects"], *_effects(rng)]},
        "terrain": _terrain(rng),
        "payload": _payload(rng),
        **_channels(rng),
        "sensors": _noise(rng),
        "frames": {"odom_yaw_rad": float(rng.uniform(-3.1, 3.1)), "vision_yaw_rad": float(rng.uniform(-3.1, 3.1))},
        "clock": {"skew_s": float(rng.choice([0.0, 1.0, 1e4, 1e8]) * rng.uniform(-1.0, 1.0))},
        "battery": {"charge_percent": float(rng.uniform(20.0, 100.0)), "temperature_c": float(rng.uniform(-5.0, 45.0))},
        "motors": {"start_temperature_c": float(rng.uniform(-5.0, 60.0)), "ambient_c": float(rng.uniform(-10.0, 40.0))},
        "motion": {"stand_height_m": float(rng.uniform(0.48, 0.56))},
    }
    return Reality(data, sensors, pushes)


def draw_quiet(rng: np.random.Generator, duration_s: float) -> Walk:
    """Minutes of standing, stepping in place, creeping, being held back, or a pause between two walks."""
    kind = str(rng.choice(["standing", "marching", "creeping", "held", "pause"]))
    size, sign = float(rng.uniform(0.5, 1.0)), float(rng.choice([-1.0, 1.0]))
    waypoints = {
        "standing": [Waypoint(time_s=0.0)],
        "marching": [Waypoint(time_s=0.0, yaw_rate_rad_s=0.05 * size * sign)],
        "creeping": [Waypoint(time_s=0.0, v_x_m_s=0.05 * size)],
        "held": [Waypoint(time_s=0.0, v_x_m_s=0.2 * size)],
        "pause": [
            Waypoint(time_s=0.0, v_x_m_s=0.3 * size),
            Waypoint(time_s=5.0),
            Waypoint(time_s=max(6.0, duration_s - 5.0), v_x_m_s=0.3 * size, yaw_rate_rad_s=0.3 * sign),
        ],
    }[kind]
    commands = VelocitySequence(name=kind, duration_s=duration_s, waypoints=tuple(waypoints))
    return Walk(commands, Push(0.5, -0.1 * size, 0.0, 0.0) if kind == "held" else None)


def draw_walk(rng: np.random.Generator, contract: PolicyContract) -> Walk:
    """Commands within a policy's range: some seconds each, reached at once or by a ramp, small ones more often."""
    low, high = np.array(contract.velocity_command_low), np.array(contract.velocity_command_high)
    duration_s, time_s = float(rng.uniform(*SECONDS)), 0.0
    waypoints = [Waypoint(time_s=0.0)]
    while (time_s := time_s + float(rng.uniform(0.5, 3.0))) < duration_s:
        share = rng.uniform(-1.0, 1.0, 3) ** 2 * np.sign(rng.uniform(-0.4, 1.0, 3)) * (rng.random(3) < (0.9, 0.5, 0.5))
        v_x, v_y, yaw = (float(v) for v in np.where(share > 0.0, share * high, -share * low))
        is_ramp = bool(rng.random() < 0.5)
        waypoints.append(Waypoint(time_s=time_s, v_x_m_s=v_x, v_y_m_s=v_y, yaw_rate_rad_s=yaw, ramp=is_ramp))
    return Walk(VelocitySequence(name="drawn", duration_s=duration_s, waypoints=tuple(waypoints)))


def _effects(rng: np.random.Generator) -> list[dict[str, Any]]:
    """About half of what may be a little wrong with a robot, each by itself."""
    normal, uniform = rng.normal, rng.uniform
    some: list[dict[str, Any]] = [
        {"effect": "leg_mass", "scale": normal(1.0, 0.08)},
        {"effect": "body_inertia", "scale": normal(1.0, 0.1)},
        {"effect": "com_offset", "x_m": normal(0.0, 0.01), "y_m": normal(0.0, 0.006), "z_m": normal(0.0, 0.008)},
        {"effect": "foot_radius", "change_m": uniform(-0.004, 0.004)},
        {"effect": "ground_compliance", "time_constant_s": uniform(0.01, 0.05)},
        {"effect": "armature", "joints": ["all"], "inertia_kg_m2": uniform(0.03, 0.09)},
        {"effect": "backlash", "joints": ["knees"], "gap_rad": uniform(0.0, 0.012)},
        {"effect": "viscous_friction", "joints": ["all"], "damping_nm_s_per_rad": uniform(0.0, 0.4)},
        {"effect": "stribeck_friction", "joints": ["all"], "level_nm": uniform(0.0, 3.0), "speed_rad_s": 0.3},
        {"effect": "load_friction", "joints": ["knees"], "share": uniform(0.0, 0.15)},
        {"effect": "torque_gain", "joints": ["all"], "gain": uniform(0.9, 1.08)},
        {"effect": "torque_bandwidth", "joints": ["all"], "time_constant_s": uniform(0.0, 0.006)},
        {"effect": "torque_ripple", "joints": ["all"], "amplitude_nm": uniform(0.0, 0.8), "cycles_per_rad": 60.0},
        {"effect": "encoder_offset", "joints": ["knees"], "offset_rad": normal(0.0, 0.01)},
        {"effect": "encoder_offset", "joints": ["hips"], "offset_rad": normal(0.0, 0.01)},
        {"effect": "imu_tilt", "roll_rad": normal(0.0, 0.01), "pitch_rad": normal(0.0, 0.01)},
        {"effect": "load_sensor_gain", "joints": ["all"], "gain": uniform(0.9, 1.1), "bias_nm": normal(0.0, 1.0)},
        {"effect": "velocity_filter", "joints": ["all"], "time_constant_s": uniform(0.0, 0.008)},
        {"effect": "velocity_estimate", "scale": uniform(0.94, 1.06), "lag_s": uniform(0.0, 0.04)},
        {"effect": "contact_delay", "delay_s": uniform(0.0, 0.03)},
        {"effect": "command_drop", "probability": uniform(0.0, 0.03)},
    ]
    return [
        {key: float(value) if isinstance(value, float) else value for key, value in effect.items()}
        for effect in some
        if rng.random() < 0.5
    ]


def _terrain(rng: np.random.Generator) -> dict[str, Any]:
    friction = float(rng.uniform(0.25, 1.1))
    kind = rng.choice(["flat", "rough", "hilly"], p=[0.4, 0.35, 0.25])
    if kind == "flat":
        return {"friction": friction}
    if kind == "rough":
        cell_m, amplitude_m = float(rng.uniform(0.2, 0.6)), float(rng.uniform(0.005, 0.04))
    else:  # slopes of up to some ten degrees
        cell_m, amplitude_m = 2.0, float(rng.uniform(0.05, 0.2))
    ground = {"kind": "noise", "amplitude_m": amplitude_m, "cell_m": cell_m, "half_size_m": 45.0}
    return {**ground, "friction": friction}


def _payload(rng: np.random.Generator) -> dict[str, Any]:
    """Up to the 14 kg that the robot is sold to carry, on its back."""
    if rng.random() < 0.5:
        return {}
    place = (rng.uniform(-0.2, 0.2), rng.uniform(-0.04, 0.04), rng.uniform(0.08, 0.2))
    return {"mass_kg": float(rng.uniform(0.5, 14.0)), "com_in_body_m": [float(v) for v in place]}


def _channels(rng: np.random.Generator) -> dict[str, Any]:
    """Both ways of the link, 2 to 20 ms together on average, each with a tail."""
    total_s, up_share = float(rng.uniform(0.002, MAX_DELAY_S)), float(rng.uniform(0.2, 0.8))

    def channel(mean_s: float, drops: float) -> dict[str, Any]:
        shape, tail = float(rng.uniform(1.5, 4.0)), float(rng.uniform(0.05, 0.3))
        delay = {"kind": "gamma", "floor_s": mean_s * (1.0 - tail), "shape": shape, "scale_s": mean_s * tail / shape}
        return {"delay": delay, "drop_probability": drops}

    return {
        "state_channel": channel(total_s * up_share, float(rng.choice([0.0, rng.uniform(0.0, 0.01)]))),
        "command_channel": channel(total_s * (1.0 - up_share), float(rng.choice([0.0, rng.uniform(0.0, 0.03)]))),
    }


def _noise(rng: np.random.Generator) -> dict[str, Any]:
    """From a sensor that is almost perfect to a poor one."""
    ranges = {
        "position_rad": (1e-5, 1e-3),
        "velocity_rad_s": (0.003, 0.1),
        "load_nm": (0.05, 2.0),
        "body_velocity_m_s": (0.002, 0.05),
        "body_angular_velocity_rad_s": (0.001, 0.05),
        "attitude_rad": (1e-4, 0.005),
        "imu_acceleration_m_s2": (0.02, 0.6),
        "imu_angular_velocity_rad_s": (0.001, 0.03),
    }
    drawn: dict[str, Any] = {name: float(_log_uniform(rng, *ends)) for name, ends in ranges.items()}
    drawn["contact_threshold_n"] = float(rng.uniform(5.0, 40.0))
    drawn["imu_from_body_m"] = [float(v) for v in rng.normal(0.0, (0.1, 0.03, 0.03))]
    drawn["has_negated_imu_quaternion"] = bool(rng.random() < 0.5)
    return drawn


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
