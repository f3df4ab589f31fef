"""All trials of a policy as one dictionary."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from trainer.evaluate import trials
from trainer.evaluate.setting import Setting

SCHEMA = "spot-rl/evaluation/1"


def evaluate(setting: Setting, *, n: int = 100, tell: Callable[[str], None] = lambda _: None) -> dict[str, Any]:
    """Run every trial.

    Args:
        setting: Policy and robots.
        n: Robots in each trial that counts survivors.
        tell: Called with the name of each trial before it runs.
    """
    high, paper = setting.policy.contract.velocity_command_high, trials.PAPER.v_x_m_s[1]
    steps: dict[str, Callable[[], dict[str, Any]]] = {
        "tracking": lambda: trials.tracking(setting),
        "top_speed": lambda: trials.top_speed(setting),
        "episodes_slow": lambda: trials.episodes(setting, n, bottom_m_s=0.0, top_m_s=3.0),
        "pushes": lambda: trials.pushes(setting, n, v_x_m_s=min(1.0, high[0])),
        "slippery_patch": lambda: trials.slippery_patch(setting, n, v_x_m_s=min(2.0, high[0])),
    }
    if high[0] > 3.0:
        steps["episodes_fast"] = lambda: trials.episodes(setting, n, bottom_m_s=3.0, top_m_s=paper)
    if high[0] > paper:
        steps["episodes_beyond"] = lambda: trials.episodes(setting, n, bottom_m_s=paper, top_m_s=high[0])
    result: dict[str, Any] = {
        "schema": SCHEMA,
        "policy": setting.policy.contract.name,
        "policy_sha256": setting.policy.sha256,
        "model_sha256": setting.model.digest(),
        "physics": {"timestep_s": setting.mjcf.timestep_s, "integrator": setting.mjcf.integrator},
        "seed": setting.seed,
    }
    for name, run in steps.items():
        tell(name)
        result[name] = run()
    return result
