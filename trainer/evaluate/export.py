"""From a checkpoint to an ONNX file that describes itself, its gait included."""

from __future__ import annotations

from pathlib import Path

import torch

from spot_model.io.model_file import RobotModel
from spot_model.io.models_file import load_models
from spot_model.io.whole import check_new, whole_file
from spot_model.policy.contract import PolicyContract, TrainingRecord
from spot_model.policy.policy import load_policy
from trainer.config.train_config import TrainConfig
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
from trainer.simulate.stated_gait import with_gait


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
