"""The policy of a checkpoint: the actor's layers as an ONNX model with its contract."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from rsl_rl.models import MLPModel

from spot_model.errors import BadInputError
from spot_model.io.models_file import load_models
from spot_model.policy.contract import INPUT_NAME, METADATA_KEY, OUTPUT_NAME, PolicyContract, StoredPair, TrainingRecord
from spot_model.policy.observation import COLUMNS, N_OBSERVATION, OBSERVATION
from spot_model.policy.policy import Policy, load_policy, policy_from_bytes
from spot_model.robot import facts
from trainer.config.train_config import TrainConfig
from trainer.ppo.checkpoint import config_of, find_checkpoint, read_checkpoint, read_run_record

NORMALISER_FLOOR = 1.0e-2
"""Added to the deviation by rsl-rl's normaliser."""
LARGEST_ERROR = 1.0e-5
"""Largest difference between torch and onnxruntime on the check inputs, a share of the largest action if above 1."""

POLICY_STD = 0.3
"""Standard deviation of the actions of a run that starts from a policy, unless its config says another."""
IGNORED = (torch.nn.Identity, torch.nn.Flatten, torch.nn.Dropout)
"""Layers that do nothing to a batch of observations when a policy acts."""
PARTS = ("weight", "bias")

N_INPUTS = 256
"""Random inputs on which a file is compared with its network."""
FloatArray = np.ndarray[Any, np.dtype[np.float32]]
Layers = list[tuple[torch.Tensor, torch.Tensor]]
"""Weight (out, in) and bias (out,) of each linear layer; ELU between them."""


def policy_of_layers(layers: Layers, contract: PolicyContract, source: str = "export") -> Policy:
    """A network with its contract, as the runtime loads it; ``file_bytes`` of it is the file.

    It is run beside torch on random inputs, of which the first becomes the contract's stored pair.

    Raises:
        BadInputError: Both differ by more than 1e-5 of the largest action, or 1e-5 if that is below 1: they round
            differently, and not alike on every processor.
    """
    inputs = np.random.default_rng(48).normal(size=(N_INPUTS, N_OBSERVATION)).astype(np.float32)
    with torch.no_grad():
        wanted = run_torch(layers, torch.from_numpy(inputs)).numpy()
    pair = StoredPair(observation=tuple(inputs[0].tolist()), action=tuple(wanted[0].tolist()))
    policy = policy_from_bytes(onnx_bytes(layers, contract.model_copy(update={"stored_pair": pair})), source=source)
    check_agreement(policy.act(inputs), wanted)
    return policy


def check_agreement(actions: FloatArray, wanted: FloatArray) -> None:
    """Compare what onnxruntime and torch made of the same inputs; raises as :func:`policy_of`."""
    error = float(np.abs(actions - wanted).max())
    allowed = LARGEST_ERROR * max(1.0, float(np.abs(wanted).max()))
    if not error <= allowed:
        raise BadInputError(f"torch and onnxruntime differ by {error:g}; allowed: at most {allowed:g}")


def policy_of_checkpoint(checkpoint: Path) -> tuple[Policy, TrainConfig]:
    """The policy of a checkpoint, no gait stated, and the config of its training, whose name it has.

    Raises:
        BadInputError: It is not a checkpoint of this trainer.
    """
    content = read_checkpoint(checkpoint)
    config, record = config_of(content, str(checkpoint)), read_run_record(checkpoint.parent)
    training = TrainingRecord(
        run=f"{config.name}/{checkpoint.stem}/{hashlib.sha256(checkpoint.read_bytes()).hexdigest()[:12]}",
        revision=str(record.get("revision", "")),
        command=str(record.get("command", "")),
        seed=config.seed,
        model_sha256=load_models(config.model)[0].digest(),
    )
    layers = actor_layers(content["algorithm"]["actor_state_dict"])
    return policy_of_layers(layers, contract_of(config, config.name, training), str(checkpoint)), config


def contract_of(config: TrainConfig, name: str, training: TrainingRecord) -> PolicyContract:
    """The contract of a network that was trained on a config's task; :func:`policy_of` fills in the stored pair."""
    commands = config.task.commands
    low, high = zip(commands.v_x_m_s, commands.v_y_m_s, commands.yaw_rate_rad_s, strict=True)
    pair = StoredPair(observation=(0.0,) * N_OBSERVATION, action=(0.0,) * facts.N_JOINTS)
    return PolicyContract(
        name=name, velocity_command_low=low, velocity_command_high=high, training=training, stored_pair=pair
    )


def actor_layers(state: dict[str, torch.Tensor]) -> Layers:
    """The linear layers of an actor's state dict, in order; observation normalisation goes into the first one."""
    numbers = sorted(int(key.split(".")[1]) for key in state if key.startswith("mlp.") and key.endswith(".weight"))
    layers = [(state[f"mlp.{i}.weight"].float(), state[f"mlp.{i}.bias"].float()) for i in numbers]
    if "obs_normalizer._mean" in state:
        weight, bias = (t.double() for t in layers[0])
        mean, std = state["obs_normalizer._mean"].double(), state["obs_normalizer._std"].double()
        weight = weight / (std + NORMALISER_FLOOR)
        layers[0] = (weight.float(), (bias - weight @ mean[0]).float())
    return layers


def layers_of(network: torch.nn.Module) -> Layers:
    """The linear layers of a network of ours: ELU between them, 48 numbers in, 12 out.

    The normaliser of an rsl-rl actor goes into the first layer.

    Raises:
        BadInputError: The network is of another kind.
    """
    if isinstance(network, MLPModel):
        layers_of(network.mlp)
        return actor_layers({name: value.detach().cpu() for name, value in network.state_dict().items()})
    modules = [m for _, m in network.named_modules(remove_duplicate=False)]
    parts = [m for m in modules if not any(m.children()) and not isinstance(m, IGNORED)]
    linear = [m for m in parts[::2] if isinstance(m, torch.nn.Linear)]
    between = [m for m in parts[1::2] if isinstance(m, torch.nn.ELU) and m.alpha == 1.0]
    layers = [(m.weight.detach().cpu().float(), _bias(m).detach().cpu().float()) for m in linear]
    widths = (N_OBSERVATION, facts.N_JOINTS)
    if (
        len(linear) != len(between) + 1
        or len(linear) + len(between) != len(parts)
        or (layers[0][0].shape[1], layers[-1][0].shape[0]) != widths
    ):
        told = ", ".join(str(m) for m in parts) or "no layers"
        raise BadInputError(
            f"network has {told:.300}; allowed: torch.nn.Linear layers with torch.nn.ELU between them, {widths[0]} "
            f"numbers in and {widths[1]} out; give the layers in their order, as torch.nn.Sequential(...)"
        )
    return layers


def _bias(layer: torch.nn.Linear) -> torch.Tensor:
    bias: torch.Tensor | None = layer.bias
    return layer.weight.new_zeros(layer.out_features) if bias is None else bias


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
            "only networks that spot-rl export wrote can be refined or retrained"
        )
    return layers


def networks_of_policy(path: Path) -> tuple[dict[str, Any], tuple[int, ...]]:
    """An ONNX policy's actor in canonical joint order, to start a training from, and the widths of its hidden layers.

    Raises:
        BadInputError: The network is of another kind, or its actions mean something else to the servos than those of
            this trainer.
    """
    contract = load_policy(path).contract
    found = {
        **contract.model_dump(include={"action_scale_rad", "rate_hz", "observation_history"}),
        "kp_nm_per_rad": set(contract.kp_nm_per_rad),
        "kd_nm_s_per_rad": set(contract.kd_nm_s_per_rad),
    }
    wanted = {
        "action_scale_rad": facts.ACTION_SCALE_RAD,
        "rate_hz": facts.POLICY_RATE_HZ,
        "observation_history": 1,
        "kp_nm_per_rad": {facts.POLICY_KP_NM_PER_RAD},
        "kd_nm_s_per_rad": {facts.POLICY_KD_NM_S_PER_RAD},
    }
    order = [contract.joint_names.index(name) for name in facts.JOINT_NAMES]
    if not np.allclose(np.array(contract.default_position_rad)[order], facts.DEFAULT_POSITION_RAD, atol=1e-6):
        raise BadInputError(f"policy {path} has another default pose than this trainer; it cannot be trained further")
    for key, value in wanted.items():
        if found[key] != value:
            raise BadInputError(f"policy {path} has {key} = {found[key]}; only {value} can be trained further")
    layers = read_layers(path.read_bytes(), str(path))
    columns = [COLUMNS[f.name].start + i for f in OBSERVATION for i in (order if f.is_of_joints else range(f.width))]
    layers[0] = (layers[0][0][:, columns], layers[0][1])
    layers[-1] = (layers[-1][0][order], layers[-1][1][order])
    actor = {f"mlp.{2 * i}.{name}": v for i, pair in enumerate(layers) for name, v in zip(PARTS, pair, strict=True)}
    actor["distribution.std_param"] = torch.full((facts.N_JOINTS,), POLICY_STD)
    return {"algorithm": {"actor_state_dict": actor}}, tuple(len(bias) for _, bias in layers[:-1])


def run_torch(layers: Layers, observation: torch.Tensor) -> torch.Tensor:
    """The network in torch, shape (n, 48) to (n, 12)."""
    x = observation
    for i, (weight, bias) in enumerate(layers):
        x = torch.nn.functional.linear(x, weight, bias)
        if i + 1 < len(layers):
            x = torch.nn.functional.elu(x)
    return x


def onnx_bytes(layers: Layers, contract: PolicyContract) -> bytes:
    """One ONNX file with a dynamic batch, weights inside, and the contract as metadata."""
    nodes, weights = [], []
    current = INPUT_NAME
    for i, (weight, bias) in enumerate(layers):
        is_last = i + 1 == len(layers)
        weights += [
            numpy_helper.from_array(weight.numpy(), f"weight_{i}"),
            numpy_helper.from_array(bias.numpy(), f"bias_{i}"),
        ]
        output = OUTPUT_NAME if is_last else f"linear_{i}"
        nodes.append(helper.make_node("Gemm", [current, f"weight_{i}", f"bias_{i}"], [output], transB=1))
        if not is_last:
            nodes.append(helper.make_node("Elu", [output], [f"elu_{i}"], alpha=1.0))
        current = f"elu_{i}"
    graph = helper.make_graph(
        nodes,
        "policy",
        [helper.make_tensor_value_info(INPUT_NAME, TensorProto.FLOAT, ["batch", N_OBSERVATION])],
        [helper.make_tensor_value_info(OUTPUT_NAME, TensorProto.FLOAT, ["batch", facts.N_JOINTS])],
        weights,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], producer_name="spot-rl")
    model.ir_version = 8
    helper.set_model_props(model, {METADATA_KEY: contract.to_json()})
    onnx.checker.check_model(model, full_check=True)
    data: bytes = model.SerializeToString()
    return data


LOOKED_EVERY_S = 2.0


class NewestPolicy:
    """Looks for a newer checkpoint now and then."""

    def __init__(self, run: Path, tell: Callable[[str], None]) -> None:
        self._run, self._tell = run, tell
        self._seen: Path | None = None
        self._looked_s = -LOOKED_EVERY_S

    def load(self) -> Policy:
        """The newest. Raises BadInputError: the run has no checkpoint yet."""
        self._seen = find_checkpoint(self._run)
        self._tell(self._seen.name)
        return policy_of_checkpoint(self._seen)[0]

    def newer(self) -> Policy | None:
        """One that is newer than the last; None if there is none, or it was looked for a moment ago."""
        now_s = time.monotonic()
        if now_s - self._looked_s < LOOKED_EVERY_S:
            return None
        self._looked_s = now_s
        return None if find_checkpoint(self._run) == self._seen else self.load()
