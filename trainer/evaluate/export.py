"""From a checkpoint to an ONNX file that describes itself, its gait included."""

from __future__ import annotations

from pathlib import Path

import torch

from spot_model.io.model_file import RobotModel
from spot_model.io.models_file import load_models
from spot_model.io.whole import check_new
from spot_model.policy.contract import TrainingRecord
from spot_model.policy.policy import Policy, load_policy
from trainer.config.train_config import TrainConfig
from trainer.ppo.checkpoint import find_checkpoint
from trainer.ppo.checkpoint_policy import contract_of, layers_of, policy_of_checkpoint, policy_of_layers
from trainer.simulate.stated_gait import write_with_gait


def export_policy(run: Path, out: Path, name: str | None = None) -> Policy:
    """Write the newest checkpoint's actor as ONNX with its contract; refuses to overwrite.

    Args:
        run: A run folder, a checkpoint, or a policy's ONNX file, whose gait is then measured anew.
        out: The file to write.
        name: Name in the contract; the config's, or the file's own, by default.

    Returns:
        What was written.

    Raises:
        OutputExistsError: ``out`` exists.
        BadInputError: There is no checkpoint, or the networks disagree by more than 1e-5.
    """
    check_new(out)
    if run.suffix == ".onnx":
        policy, model = load_policy(run), "paper_identified"
    else:
        policy, config = policy_of_checkpoint(find_checkpoint(run))
        model = config.model
    return write_with_gait(policy, load_models(model)[0], out, name)


def export_network(
    network: torch.nn.Module, config: TrainConfig, model: RobotModel, out: Path, name: str, action_unit: float
) -> Policy:
    """Write a network that another library trained on the task as ONNX with its contract; refuses to overwrite.

    Args:
        network: Linear layers with ELU between them, 48 numbers in, 12 out.
        config: The task that it was trained on.
        model: The robot that it was trained on.
        out: The file to write.
        name: Name in the contract.
        action_unit: The network's 1 in a policy's unit of 0.2 rad.

    Returns:
        What was written.

    Raises:
        OutputExistsError: ``out`` exists.
        BadInputError: The network is of another kind.
    """
    check_new(out)
    layers = layers_of(network)
    weight, bias = layers[-1]
    layers[-1] = (action_unit * weight, action_unit * bias)
    contract = contract_of(config, name, TrainingRecord(model_sha256=model.digest()))
    return write_with_gait(policy_of_layers(layers, contract), model, out)
