"""All trials of a policy as one dictionary."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from trainer.evaluate import trials
from trainer.evaluate.setting import Setting

SCHEMA = "spot-rl/evaluation/1"
Trial = Callable[[], dict[str, Any]]


def evaluate(
    setting: Setting,
    *,
    n: int = 100,
    done: Mapping[str, Any] | None = None,
    tell: Callable[[str, float], None] = lambda _name, _share: None,
    keep: Callable[[dict[str, Any]], None] = lambda _: None,
) -> dict[str, Any]:
    """Run every trial.

    Args:
        setting: Policy and robots.
        n: Robots in each trial that counts survivors.
        done: What ``keep`` was given in an evaluation that was interrupted; its trials are not run again.
        tell: Called before each trial with its name and the share of the work that is done.
        keep: Called after each trial with all that there is.
    """
    steps = _trials(setting, n)
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
        "physics": {"timestep_s": setting.mjcf.timestep_s, "integrator": setting.mjcf.integrator},
        "seed": setting.seed,
    }


def _trials(setting: Setting, n: int) -> dict[str, tuple[float, Trial]]:
    """Each trial by name, with the seconds that its robots walk, roughly: they say how long it takes."""
    high, paper = setting.policy.contract.velocity_command_high, trials.PAPER.v_x_m_s[1]
    steady_s = high[0] / trials.RAMP_M_S2 + 10.0
    steps: dict[str, tuple[float, Trial]] = {
        "tracking": ((15.0 + 2.0 * high[0]) * steady_s, lambda: trials.tracking(setting)),
        "top_speed": (4.0 * high[0] * steady_s, lambda: trials.top_speed(setting)),
        "episodes_slow": (20.0 * n, lambda: trials.episodes(setting, n, bottom_m_s=0.0, top_m_s=3.0)),
        "pushes": (10.0 * n, lambda: trials.pushes(setting, n, v_x_m_s=min(1.0, high[0]))),
        "slippery_patch": (12.0 * n, lambda: trials.slippery_patch(setting, n, v_x_m_s=min(2.0, high[0]))),
    }
    if high[0] > 3.0:
        steps["episodes_fast"] = (20.0 * n, lambda: trials.episodes(setting, n, bottom_m_s=3.0, top_m_s=paper))
    if high[0] > paper:
        steps["episodes_beyond"] = (20.0 * n, lambda: trials.episodes(setting, n, bottom_m_s=paper, top_m_s=high[0]))
    return steps
