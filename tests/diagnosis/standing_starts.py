"""Scripts of closed loops: one standing start of each of two sequences."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from spot_model.plant.closed_loop import StartState
from spot_model.robot import facts
from trainer.signals.policy_ticks import Script

POLICY = Path(__file__).parents[2] / "policies" / "baseline.onnx"


def scripts(n_ticks: int = 110) -> list[Script]:
    """One standing start of each of two sequences."""
    start = StartState(
        position_rad=np.asarray(facts.DEFAULT_POSITION_RAD),
        velocity_rad_s=np.zeros(12),
        world_from_body_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        linear_vel_of_body_in_world_m_s=np.zeros(3),
        angular_vel_of_body_in_world_rad_s=np.zeros(3),
        last_action=np.zeros(12, dtype=np.float32),
    )
    commands = {"a": np.array([0.6, 0.0, 0.0]), "b": np.zeros(3)}
    return [Script(name, 1, start, np.tile(command, (n_ticks, 1))) for name, command in commands.items()]
