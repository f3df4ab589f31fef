"""From a checkpoint to an ONNX file that describes itself, its gait included."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import helper

from spot_model.io.model_file import RobotModel
from spot_model.io.models_file import load_models
from spot_model.io.whole import check_new, whole_file
from spot_model.policy.contract import FALL, METADATA_KEY, PolicyContract, StatedGait, TrainingRecord
from spot_model.policy.policy import Policy, load_policy, policy_from_bytes
from trainer.config.train_config import TrainConfig
from trainer.evaluate.setting import Setting
from trainer.ppo.checkpoint import find_checkpoint
from trainer.ppo.checkpoint_policy import (
    Layers,
    check_agreement,
    contract_of,
    layers_of,
    onnx_bytes,
    read_actor,
    read_layers,
)
from trainer.simulate.walks import hold

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
    plant = Setting(policy=policy, model=model).plant(len(target))
    recording = hold(policy, plant, target, RAMP_S, steady_s + WATCH_S)
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


def with_gait(data: bytes, model: RobotModel) -> bytes:
    """A policy's file with its gait on that robot in the contract, in place of what it stated."""
    policy, made = policy_from_bytes(data, source="the policy"), onnx.load_from_string(data)
    contract = policy.contract.model_copy(update={"gait": stated_gaits(policy, model)})
    helper.set_model_props(made, {p.key: p.value for p in made.metadata_props} | {METADATA_KEY: contract.to_json()})
    return bytes(made.SerializeToString())


def export_policy(run: Path, out: Path, name: str | None = None) -> Path:
    """Write the newest checkpoint's actor as ONNX with its contract; refuses to overwrite.

    Args:
        run: A run folder, a checkpoint, or an ONNX policy of this project, whose gait is then measured anew.
        out: The file to write.
        name: Name in the contract; the config's by default.

    Raises:
        OutputExistsError: ``out`` exists.
        BadInputError: There is no checkpoint, or the networks disagree by more than 1e-5.
    """
    check_new(out)
    if run.suffix == ".onnx":
        contract, layers, model = load_policy(run).contract, read_layers(run.read_bytes(), str(run)), "paper_identified"
        contract = contract.model_copy(update={"name": name or contract.name})
    else:
        config, layers, contract = read_actor(find_checkpoint(run), name)
        model = config.model
    return _written(layers, contract, load_models(model)[0], out)


def export_network(
    network: torch.nn.Module, config: TrainConfig, model: RobotModel, out: Path, name: str, action_unit: float
) -> Path:
    """Write a network that another library trained on the task as ONNX with its contract; refuses to overwrite.

    Args:
        network: Linear layers with ELU between them, 48 numbers in, 12 out.
        config: The task that it was trained on.
        model: The robot that it was trained on.
        out: The file to write.
        name: Name in the contract.
        action_unit: The network's 1 in a policy's unit of 0.2 rad.

    Raises:
        OutputExistsError: ``out`` exists.
        BadInputError: The network is of another kind.
    """
    check_new(out)
    layers = layers_of(network)
    weight, bias = layers[-1]
    layers[-1] = (action_unit * weight, action_unit * bias)
    return _written(layers, contract_of(config, layers, name, TrainingRecord(model_sha256=model.digest())), model, out)


def _written(layers: Layers, contract: PolicyContract, model: RobotModel, out: Path) -> Path:
    data = with_gait(onnx_bytes(layers, contract), model)
    check_agreement(layers, data)
    with whole_file(out) as part:
        part.write_bytes(data)
    return out
