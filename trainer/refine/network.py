"""The layers of a policy file, and a policy file of changed layers."""

from __future__ import annotations

import onnx
import torch
from onnx import numpy_helper

from spot_model.errors import BadInputError
from spot_model.policy.contract import PolicyContract, StoredPair, TrainingRecord
from spot_model.policy.policy import Policy, policy_from_bytes
from trainer.ppo.checkpoint_policy import Layers, check_agreement, onnx_bytes, run_torch


def read_layers(data: bytes, source: str) -> Layers:
    """Weight (out, in) and bias (out,) of each layer of a policy that ``spot-rl export`` wrote.

    Raises:
        BadInputError: The network is of another kind.
    """
    weights = {i.name: numpy_helper.to_array(i) for i in onnx.load_from_string(data).graph.initializer}
    layers: Layers = []
    while f"weight_{len(layers)}" in weights and f"bias_{len(layers)}" in weights:
        k = len(layers)
        layers.append((torch.tensor(weights[f"weight_{k}"]), torch.tensor(weights[f"bias_{k}"])))
    if not layers or len(weights) != 2 * len(layers):
        raise BadInputError(
            f"policy {source} has the weights {', '.join(sorted(weights)) or 'none'}; "
            "only networks that spot-rl export wrote can be refined"
        )
    return layers


def policy_of(layers: Layers, contract: PolicyContract, record: TrainingRecord | None = None) -> tuple[Policy, bytes]:
    """A policy with these layers and, but for its stored pair and record, this contract; and its file's bytes."""
    observation = torch.tensor([contract.stored_pair.observation], dtype=torch.float32)
    with torch.no_grad():
        action = run_torch(layers, observation)[0]
    pair = StoredPair(
        observation=contract.stored_pair.observation,
        action=tuple(float(v) for v in action),
        tolerance=contract.stored_pair.tolerance,
    )
    changed = contract.model_copy(update={"stored_pair": pair, "training": record or contract.training})
    data = onnx_bytes(layers, changed)
    check_agreement(layers, data)
    return policy_from_bytes(data, source="refinement"), data
