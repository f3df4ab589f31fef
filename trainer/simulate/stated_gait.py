"""A policy's gait, measured in simulation, in its file: what a run tells before the motors get power."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
from onnx import helper

from spot_model.effects.side_by_side import side_by_side
from spot_model.io.model_file import RobotModel
from spot_model.io.whole import whole_file
from spot_model.plant.plant import Plant
from spot_model.policy.contract import FALL, METADATA_KEY, StatedGait
from spot_model.policy.policy import Policy, policy_from_bytes
from trainer.simulate.walks import walk_at

SPEEDS_M_S = (0.3, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)
TURN_RAD_S = 1.0
"""Commanded at each speed, or the policy's most if that is less."""
RAMP_S, SETTLE_S, WATCH_S = 4.0, 2.0, 4.0


def stated_gaits(policy: Policy, model: RobotModel) -> tuple[StatedGait, ...]:
    """Walk two robots a speed, up to the policy's own, one straight and one turning, and measure.

    A robot that falls on the straight has the gait "fall".
    """
    top = policy.contract.velocity_command_high[0]
    speeds = [v for v in SPEEDS_M_S if v <= top + 1e-9]
    if not speeds:
        return ()
    turn = min(TURN_RAD_S, policy.contract.velocity_command_high[2])
    target = np.array([[v, 0.0, yaw_rate] for yaw_rate in (0.0, turn) for v in speeds])
    steady_s = RAMP_S + SETTLE_S
    plant = Plant(side_by_side([model.effects], len(target)), len(target))
    recording = walk_at(policy, plant, target, RAMP_S, steady_s + WATCH_S)
    span = recording.ticks(steady_s, steady_s + WATCH_S)
    mean = recording.mean_velocity(span)

    def held(robot: int, axis: int) -> float | None:
        return round(float(mean[robot, axis]), 3) if recording.survived[robot] else None

    stated = []
    for robot, speed in enumerate(speeds):
        figures = recording.gait(span, robot)
        stated.append(
            StatedGait(
                v_x_m_s=speed,
                v_x_held_m_s=held(robot, 0),
                name=figures["gait"] if recording.survived[robot] else FALL,
                turn_commanded_rad_s=turn,
                turn_held_rad_s=held(len(speeds) + robot, 2),
                **{key: figures[key] for key in StatedGait.model_fields if key in figures},
            )
        )
    return tuple(stated)


def write_with_gait(policy: Policy, model: RobotModel, out: Path, name: str | None = None) -> Policy:
    """Write a policy with its gait on that robot, and its name if one is given, in its contract; returns what it wrote.

    Raises:
        OutputExistsError: ``out`` exists.
    """
    changes = {"name": name or policy.contract.name, "gait": stated_gaits(policy, model)}
    made = onnx.load_from_string(policy.file_bytes)
    contract = {METADATA_KEY: policy.contract.model_copy(update=changes).to_json()}
    helper.set_model_props(made, {p.key: p.value for p in made.metadata_props} | contract)
    stated = policy_from_bytes(made.SerializeToString(), source="the policy")
    with whole_file(out) as part:
        part.write_bytes(stated.file_bytes)
    return stated
