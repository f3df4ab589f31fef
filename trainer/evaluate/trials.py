"""Trials of a policy and their figures, one by one and all together."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot_model.io.model_file import RobotModel
from spot_model.plant.plant import Plant
from spot_model.robot.facts import Array
from trainer.config.task_config import CommandConfig
from trainer.evaluate.holds import CONDITIONS, SECONDS, holds
from trainer.evaluate.setting import Setting, set_friction
from trainer.simulate.walks import Disturb, WalkRecord, record_walks, walk_at

RAMP_M_S2 = 0.5
"""Commanded acceleration in ramps, as in the paper's forward sequence at 4 m/s (10 s)."""


MOST_TOLD = 20
"""Falls of a trial that are told one by one."""
STEADY_FROM_M_S = 0.5
"""Forward speed from which the feet are compared."""
PAPER = CommandConfig()


def tracking(setting: Setting) -> dict[str, Any]:
    """Mean tracking error over the policy's command range: V_x, V_y and ω_z one at a time, 10 s after a ramp."""
    low, high = (np.array(v) for v in _command_bounds(setting))
    commands = [np.zeros(3)]
    for axis in range(3):
        commands += [np.eye(3)[axis] * value for value in _grid(low[axis], high[axis], 0.5)]
    for v_x in (v for v in (1.0, 2.0, 3.0) if v <= high[0]):
        commands += [np.array([v_x, min(0.5, high[1]), 0.0]), np.array([v_x, 0.0, min(1.0, high[2])])]
    target = np.array(commands)
    ramp_s = float(np.abs(target[:, 0]).max() / RAMP_M_S2) if len(target) else 0.0
    recording = walk_at(setting.policy, setting.plant(len(target)), target, ramp_s, ramp_s + 10.0)
    span = recording.ticks(ramp_s + 2.0, ramp_s + 10.0)
    errors, means = recording.tracking_error(span), recording.mean_velocity(span)
    points = [
        {
            "command": [round(float(c), 3) for c in target[i]],
            "velocity": [round(float(v), 3) for v in means[i]],
            "error": [None if np.isnan(e) else round(float(e), 3) for e in errors[i]],
            "fell": not bool(recording.survived[i]),
            "power_w": round(float(recording.power_w[span, i].mean()), 1),
            **recording.gait(span, i),
        }
        for i in range(len(target))
    ]
    forward = [p for p in points if p["command"][1] == 0.0 and p["command"][2] == 0.0 and p["command"][0] <= 5.0]
    slow = [p for p in points if abs(p["command"][0]) <= 3.0]
    return {
        "points": points,
        "mean_forward_error_m_s": _mean(p["error"][0] for p in forward),
        "worst_forward_error_m_s": _worst(p["error"][0] for p in forward),
        "mean_lateral_error_m_s": _mean(p["error"][1] for p in slow),
        "mean_yaw_error_rad_s": _mean(p["error"][2] for p in slow),
        "worst_duty_spread": _worst(p["duty_spread"] for p in forward if p["command"][0] >= STEADY_FROM_M_S),
        "standing_speed_m_s": round(float(np.linalg.norm(means[0][:2])), 4),
        "standing_feet_moves_per_s": points[0]["stride_hz"],
        "peak_torque_nm": round(float(recording.torque_peak_nm.max()), 1),
        "fell": _fall_figures(recording),
    }


def top_speed(setting: Setting) -> dict[str, Any]:
    """Highest sustained speed: a ramp to each speed, held 10 s; the mean of its last 5 s, if the robot never fell."""
    _, high = _command_bounds(setting)
    speeds = np.array(sorted({*_grid(0.25, high[0], 0.25), high[0]}))
    target = np.stack([speeds, 0 * speeds, 0 * speeds], axis=-1)
    ramp_s = float(high[0] / RAMP_M_S2)
    recording = walk_at(setting.policy, setting.plant(len(target)), target, ramp_s, ramp_s + 10.0)
    span = recording.ticks(ramp_s + 5.0, ramp_s + 10.0)
    reached = recording.mean_velocity(span)[:, 0]
    held = np.where(recording.survived, reached, -np.inf)
    best = int(np.argmax(held))
    return {
        "sustained_m_s": round(float(held[best]), 3) if np.isfinite(held[best]) else None,
        "commanded_m_s": round(float(speeds[best]), 3),
        "curve": [
            [round(float(c), 3), round(float(v), 3), bool(s)]
            for c, v, s in zip(speeds, reached, recording.survived, strict=True)
        ],
        "power_w": round(float(recording.power_w[span, best].mean()), 1),
        **recording.gait(span, best),
        "fell": _fall_figures(recording),
    }


def episodes(
    setting: Setting, n: int = 100, *, bottom_m_s: float, top_m_s: float, models: Sequence[RobotModel] = ()
) -> dict[str, Any]:
    """Episodes of 20 s under randomisation, noise and pushes; commands drawn anew after 10 s.

    ``bottom_m_s`` and ``top_m_s`` bound |V_x|; V_y and ω_z are within the paper's ranges and the policy's. ``models``
    are the robots', by turns; the setting's by default.
    """
    rng = np.random.default_rng(setting.seed)
    plant, rate = setting.random_plant(n, rng, models), setting.policy.contract.rate_hz
    first, second = (random_commands(setting, n, rng, bottom_m_s=bottom_m_s, top_m_s=top_m_s) for _ in range(2))
    push_tick = rng.integers(round(5.0 * rate), round(15.0 * rate), n)
    push = np.concatenate([rng.uniform(*setting.randomisation.push_m_s, (n, 2)), np.zeros((n, 1))], axis=-1)

    recording = record_walks(
        setting.policy,
        plant,
        lambda tick: first if tick < 10.0 * rate else second,
        round(20.0 * rate),
        noise_sigma=setting.noise_sigma(),
        rng=rng,
        disturb=_shoved(push_tick, push),
    )
    falls = int((~recording.survived).sum())
    robot_s = max(1.0, float(recording.alive.sum())) / rate  # a robot may fall in its first tick
    return {
        "episodes": n,
        "falls": falls,
        "robot_s": round(robot_s, 2),
        "falls_per_hour": round(3600.0 * falls / robot_s, 2),
        "v_x_m_s": [bottom_m_s, float(_episode_bounds(setting, top_m_s)[1][0])],
        "fell": _fall_figures(recording),
    }


def pushes(setting: Setting, n: int = 100, v_x_m_s: float = 1.0) -> dict[str, Any]:
    """Robots that walk are pushed by 1 m/s in a direction drawn evenly; how many still walk 5 s later."""
    rng = np.random.default_rng(setting.seed + 1)
    rate, angle = setting.policy.contract.rate_hz, rng.uniform(-np.pi, np.pi, n)
    delta = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    # Pushed at different phases of the stride.
    when = round(4.0 * rate) + rng.integers(0, round(rate), n)
    return _survival(setting, n, v_x_m_s, 10.0, _shoved(when, delta), rng)


def _shoved(when: NDArray[np.int_], delta_m_s: Array) -> Disturb:
    """Each robot is pushed at a tick of its own, shape (n,), by a velocity in the world, shape (n, 3)."""

    def shove(robots: Plant, tick: int) -> None:
        rows = when == tick
        if rows.any():
            robots.push(linear_vel_in_world_m_s=np.where(rows[:, None], delta_m_s, 0.0))

    return shove


def slippery_patch(setting: Setting, n: int = 100, v_x_m_s: float = 2.0) -> dict[str, Any]:
    """Robots at 2 m/s meet μ 0.3 (times the factors of the model) for one second; how many walk 5 s later."""
    rng = np.random.default_rng(setting.seed + 2)
    rate = setting.policy.contract.rate_hz
    when = round(6.0 * rate) + rng.integers(0, round(rate), n)
    usual, grip = setting.mjcf.foot_friction, setting.grip()

    def change(robots: Plant, tick: int) -> None:
        since = tick - when
        inside = (since >= 0) & (since < round(rate))
        if np.isin(since, (0, round(rate))).any():
            set_friction(robots, np.where(inside, 0.3, usual)[:, None] * grip)

    return _survival(setting, n, v_x_m_s, 12.0, change, rng)


def _survival(
    setting: Setting, n: int, v_x_m_s: float, seconds: float, disturb: Disturb, rng: np.random.Generator
) -> dict[str, Any]:
    recording = walk_at(
        setting.policy,
        setting.plant(n),
        np.tile([v_x_m_s, 0.0, 0.0], (n, 1)),
        2.0,
        seconds,
        noise_sigma=setting.noise_sigma(),
        rng=rng,
        disturb=disturb,
    )
    survived = int(recording.survived.sum())
    return {"trials": n, "survived": survived, "v_x_m_s": v_x_m_s, "fell": _fall_figures(recording)}


def _fall_figures(recording: WalkRecord) -> list[dict[str, Any]]:
    """The first falls, for whoever asks when and why."""
    return [fall.figures() for fall in recording.falls[:MOST_TOLD]]


def _command_bounds(setting: Setting) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    contract = setting.policy.contract
    return contract.velocity_command_low, contract.velocity_command_high


def _episode_bounds(setting: Setting, top_m_s: float) -> tuple[Array, Array]:
    paper = np.array([PAPER.v_x_m_s, PAPER.v_y_m_s, PAPER.yaw_rate_rad_s])
    low, high = _command_bounds(setting)
    return np.maximum(low, paper[:, 0]), np.minimum(high, [top_m_s, *paper[1:, 1]])


def random_commands(
    setting: Setting, n: int, rng: np.random.Generator, *, top_m_s: float, bottom_m_s: float = 0.0
) -> Array:
    """Commands of randomised episodes, shape (n, 3): |V_x| as bounded, V_y and ω_z the paper's and the policy's."""
    low, high = _episode_bounds(setting, top_m_s)
    command = rng.uniform(low, high, (n, 3))
    size = rng.uniform(bottom_m_s, high[0], n)
    backwards = (rng.random(n) < -low[0] / (high[0] - low[0])) & (size <= -low[0])
    command[:, 0] = np.where(backwards, -size, size)
    return np.asarray(command)


def _grid(low: float, high: float, step: float) -> list[float]:
    count = round((high - low) / step)
    return [v for v in (round(low + i * step, 6) for i in range(count + 1)) if v != 0.0 and v <= high + 1e-9]


def _mean(values: Any) -> float | None:
    known = [v for v in values if v is not None]
    return round(float(np.mean(known)), 4) if known else None


def _worst(values: Any) -> float | None:
    known = list(values)
    return None if not known or any(v is None for v in known) else round(float(max(known)), 4)


SCHEMA = "spot-rl/evaluation/1"
LEAN = 0.5
"""Time that a robot second of *holds*, which records no feet, takes against one of the other trials."""
Trial = Callable[[], dict[str, Any]]


def evaluate_setting(
    setting: Setting,
    *,
    n: int = 100,
    n_each: int | None = None,
    done: Mapping[str, Any] | None = None,
    tell: Callable[[str, float], None] = lambda _name, _share: None,
    keep: Callable[[dict[str, Any]], None] = lambda _: None,
) -> dict[str, Any]:
    """Run every trial.

    Args:
        setting: Policy and robots.
        n: Robots in each trial that counts survivors.
        n_each: Robots in each condition of where the policy holds; an eighth of ``n`` if None.
        done: What ``keep`` was given in an evaluation that was interrupted; its trials are not run again.
        tell: Called before each trial with its name and the share of the work that is done.
        keep: Called after each trial with all that there is.
    """
    steps = _trials(setting, n, n_each or math.ceil(n / 8))
    result: dict[str, Any] = {**about(setting), **(done or {})}
    whole = sum(robot_s for robot_s, _ in steps.values())
    past = 0.0
    for name, (robot_s, run) in steps.items():
        if name not in result:
            tell(name, past / whole)
            result[name] = run()
            keep(result)
        past += robot_s
    return result


def about(setting: Setting) -> dict[str, Any]:
    """What was evaluated: the policy, the model, the physics and the seed."""
    return {
        "schema": SCHEMA,
        "policy": setting.policy.contract.name,
        "policy_sha256": setting.policy.sha256,
        "model_sha256": setting.model.digest(),
        **({"possible_sha256": [model.digest() for model in setting.possible]} if setting.possible else {}),
        "physics": {"timestep_s": setting.mjcf.timestep_s, "integrator": setting.mjcf.integrator},
        "seed": setting.seed,
    }


def _trials(setting: Setting, n: int, n_each: int) -> dict[str, tuple[float, Trial]]:
    """Each trial by name, with the seconds that its robots walk, roughly: they say how long it takes."""
    high, paper = setting.policy.contract.velocity_command_high, PAPER.v_x_m_s[1]
    steady_s = high[0] / RAMP_M_S2 + 10.0
    # Contacts with height fields take longer on a GPU than on two cores.
    on_cores = replace(setting, device="cpu")
    steps: dict[str, tuple[float, Trial]] = {
        "tracking": ((15.0 + 2.0 * high[0]) * steady_s, lambda: tracking(setting)),
        "top_speed": (4.0 * high[0] * steady_s, lambda: top_speed(setting)),
        "episodes_slow": (20.0 * n, lambda: episodes(setting, n, bottom_m_s=0.0, top_m_s=3.0)),
        "pushes": (10.0 * n, lambda: pushes(setting, n, v_x_m_s=min(1.0, high[0]))),
        "slippery_patch": (12.0 * n, lambda: slippery_patch(setting, n, v_x_m_s=min(2.0, high[0]))),
        "holds": (LEAN * SECONDS * len(CONDITIONS) * n_each, lambda: holds(on_cores, n_each)),
    }
    if high[0] > 3.0:
        steps["episodes_fast"] = (20.0 * n, lambda: episodes(setting, n, bottom_m_s=3.0, top_m_s=paper))
    if setting.possible:
        # The same draws on both, so that they differ by their models alone.
        robots: dict[str, Sequence[RobotModel]] = {
            "fitted_robot": (setting.model,),
            "possible_robots": setting.possible,
        }
        whole = {"bottom_m_s": 0.0, "top_m_s": high[0]}
        for name, models in robots.items():
            steps[name] = (20.0 * n, functools.partial(episodes, setting, n, **whole, models=models))
    if high[0] > paper:
        steps["episodes_beyond"] = (20.0 * n, lambda: episodes(setting, n, bottom_m_s=paper, top_m_s=high[0]))
    return steps
