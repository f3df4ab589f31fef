"""Files of other frameworks: the network's bytes, and what its side files say."""

from __future__ import annotations

import io
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import onnx
import onnxruntime
from google.protobuf.message import DecodeError
from onnx.external_data_helper import load_external_data_for_model, uses_external_data

from spot_model.errors import BadInputError
from spot_model.io.bounded_file import FileTooLargeError, read_at_most
from spot_model.policy.contract import MAX_POLICY_BYTES
from spot_model.policy.onnx_head import OnnxHeadError, read_head
from trainer.foreign import isaac_lab, mjlab, spot_rl_example
from trainer.foreign.description import ForeignPolicy
from trainer.foreign.environment import action_clip, read_agent, read_environment
from trainer.foreign.rewrite import PROOFS, TOLERANCE

TORCHSCRIPT: Final = (".pt", ".pth", ".jit", ".torchscript")
_BESIDE: Final = (
    "env.yaml",
    "params/env.yaml",
    "../params/env.yaml",
    "../../params/env.yaml",
    "env.json",
    "env_cfg.json",
)
"""Where Isaac Lab's tools leave the environment, seen from the exported policy."""


def describe_file(
    policy: Path, like: str, env: Path | None, name: str, joint_order: tuple[str, ...] = ()
) -> ForeignPolicy:
    """What a policy's side files, or its own metadata, say.

    Raises:
        BadInputError: A file is missing, or says something that cannot be done here.
    """
    if not policy.is_file():
        raise BadInputError(f"policy {policy} is no file; give an ONNX or a TorchScript file")
    if like == "mjlab":
        if env is not None or joint_order:
            raise BadInputError("mjlab's policies say all in their own metadata; leave out --env and --joint-order")
        described = mjlab.describe(_metadata(policy), name)
        return replace(described, action_clip=action_clip(read_agent(policy.parent / "params" / "env.yaml")))
    if like == "spot-rl-example":
        if joint_order:
            raise BadInputError("the example has a joint order of its own; leave out --joint-order")
        return spot_rl_example.describe(read_environment(env or spot_rl_example.find_environment(policy)), name)
    found = env or next((policy.parent / at for at in _BESIDE if (policy.parent / at).is_file()), None)
    if found is None:
        raise BadInputError(f"no env.yaml beside {policy}; name the training run's with --env")
    return isaac_lab.describe(read_environment(found), name, agent=read_agent(found), joint_order=joint_order)


def read_network(policy: Path, width: int) -> bytes:
    """An ONNX file's bytes; a TorchScript file is turned into one.

    Args:
        policy: The file.
        width: Numbers that the network sees, by which a TorchScript file is traced.

    Raises:
        BadInputError: It cannot be read, or converted.
    """
    data = _bytes_of(policy)
    if policy.suffix.lower() not in TORCHSCRIPT:
        return _with_weights(data, policy)
    import torch

    with warnings.catch_warnings():
        return _traced(torch, data, width, policy)


def _traced(torch: Any, data: bytes, width: int, policy: Path) -> bytes:
    try:
        # PyTorch announces that both steps will go; until they do, they are the only way from a script to ONNX.
        warnings.simplefilter("ignore")
        network: Any = torch.jit.load(io.BytesIO(data), map_location="cpu").eval()
        buffer: Any = io.BytesIO()
        observations = torch.randn(PROOFS, 1, width, generator=torch.Generator().manual_seed(48))
        with torch.no_grad():
            actions = [network(row).clone() for row in observations]
            has_memory = any(
                not torch.equal(network(row), action) for row, action in zip(observations, actions, strict=True)
            )
            torch.onnx.export(
                network, (observations[0],), buffer, input_names=["obs"], output_names=["actions"], dynamo=False
            )
        made = onnxruntime.InferenceSession(buffer.getvalue(), providers=["CPUExecutionProvider"])
        apart = max(
            float(np.abs(made.run(None, {"obs": row.numpy()})[0] - action.numpy()).max())
            for row, action in zip(observations, actions, strict=True)
        )
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise BadInputError(f"TorchScript file {policy} cannot be turned into ONNX: {reason}; export ONNX") from error
    if has_memory:
        raise BadInputError(
            f"TorchScript file {policy}: the same observation gives another action the second time, so the network has "
            f"a memory; only networks without memory are run"
        )
    if not apart <= TOLERANCE:
        raise BadInputError(f"TorchScript file {policy} as ONNX gives actions {apart:g} apart; export ONNX")
    return bytes(buffer.getvalue())


def _with_weights(data: bytes, policy: Path) -> bytes:
    """The model with the weights that its exporter put into a file beside it, as PyTorch's does by default."""
    try:
        model = onnx.load_from_string(data)
        if not any(uses_external_data(tensor) for tensor in model.graph.initializer):
            return data
        load_external_data_for_model(model, str(policy.parent))
    except (DecodeError, OSError, ValueError, onnx.checker.ValidationError) as error:
        raise BadInputError(
            f"policy {policy} is not whole: {error}; give the ONNX file with the .data file beside it"
        ) from error
    whole: bytes = model.SerializeToString()
    if len(whole) > MAX_POLICY_BYTES:
        raise BadInputError(f"policy {policy} has {len(whole)} bytes with its weights; allowed: {MAX_POLICY_BYTES}")
    return whole


def _metadata(policy: Path) -> dict[str, str]:
    try:
        return read_head(_bytes_of(policy)).metadata
    except OnnxHeadError as error:
        raise BadInputError(f"policy {policy} is no readable ONNX model: {error}") from error


def _bytes_of(policy: Path) -> bytes:
    try:
        return read_at_most(policy, MAX_POLICY_BYTES)
    except (OSError, FileTooLargeError) as error:
        raise BadInputError(f"policy {policy} cannot be read: {error}") from error
