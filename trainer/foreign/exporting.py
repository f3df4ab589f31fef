"""A policy of ours as what other frameworks read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import numpy as np
import onnx
import onnxruntime
from numpy.typing import NDArray
from onnx import compose, helper, numpy_helper

from spot_model.errors import BadInputError
from spot_model.io.whole import check_new, whole_folder
from spot_model.policy.contract import INPUT_NAME, OUTPUT_NAME
from spot_model.policy.observation import COLUMNS, N_OBSERVATION, OBSERVATION
from spot_model.policy.policy import Policy, load_policy
from trainer.foreign import mjlab, spot_rl_example
from trainer.foreign.description import BREADTH_FIRST

THEIR_INPUT, THEIR_OUTPUT = "obs", "actions"
TOLERANCE: Final = 1e-5
FRAMEWORKS: Final = ("mjlab", "spot-rl-example")


def export_for(policy_path: Path, framework: str, out: Path) -> list[Path]:
    """Write what ``framework`` reads.

    Args:
        policy_path: An ONNX file with our contract.
        framework: One of ``FRAMEWORKS``.
        out: For mjlab, the ONNX file to write; for the example, the folder.

    Returns:
        The files written.

    Raises:
        BadInputError: A file exists, or the policy cannot be what the framework expects.
    """
    policy = load_policy(policy_path)
    if policy.contract.observation_history != 1:
        raise BadInputError(f"policy {policy_path} sees several ticks; neither framework's reader expects that from us")
    if framework == "mjlab":
        files = {out: _network(policy_path, policy, policy.contract.joint_names)}
        metadata = mjlab.metadata_of(policy.contract, policy.contract.training.run)
        files = {path: _with_metadata(data, metadata) for path, data in files.items()}
    else:
        environment = json.dumps(spot_rl_example.environment_of(policy.contract), indent=2).encode()
        files = {
            out / "policy.onnx": _network(policy_path, policy, BREADTH_FIRST),
            out / "env_cfg.json": environment,
        }
        others = [path for pattern in ("*.json", "*.onnx") for path in out.glob(pattern)]
        if others:
            raise BadInputError(f"{out} holds {others[0].name}; the example wants a folder of one policy")
    check_new(*files)
    folder = out.parent if out in files else out
    with whole_folder(folder) as part:
        for path, data in files.items():
            (part / path.name).write_bytes(data)
    return list(files)


def _network(path: Path, policy: Policy, joint_names: tuple[str, ...]) -> bytes:
    """Our network with their names, and its joints in their order; proved on random inputs."""
    ours = onnx.load(path)
    order = np.array([policy.contract.joint_names.index(name) for name in joint_names])
    graph = compose.add_prefix_graph(ours.graph, "ours_")
    into, out = _permutation(order)
    nodes = [
        helper.make_node("MatMul", [THEIR_INPUT, "to_ours"], [f"ours_{INPUT_NAME}"]),
        *graph.node,
        helper.make_node("MatMul", [f"ours_{OUTPUT_NAME}", "to_theirs"], [THEIR_OUTPUT]),
    ]
    joined = helper.make_graph(
        nodes,
        "policy",
        [helper.make_tensor_value_info(THEIR_INPUT, onnx.TensorProto.FLOAT, [1, N_OBSERVATION])],
        [helper.make_tensor_value_info(THEIR_OUTPUT, onnx.TensorProto.FLOAT, [1, len(order)])],
        [numpy_helper.from_array(into, "to_ours"), numpy_helper.from_array(out, "to_theirs"), *graph.initializer],
    )
    model = helper.make_model(joined, opset_imports=ours.opset_import, producer_name="spot-rl")
    model.ir_version = ours.ir_version
    onnx.checker.check_model(model, full_check=True)
    data: bytes = model.SerializeToString()
    _prove(data, policy, into, out)
    return data


def _permutation(order: NDArray[np.intp]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Matrices from their observation to ours, (48, 48), and from our action to theirs, (12, 12)."""
    joints = np.zeros((len(order), len(order)), dtype=np.float32)
    joints[np.arange(len(order)), order] = 1.0
    into = np.eye(N_OBSERVATION, dtype=np.float32)
    for field in OBSERVATION:
        if field.is_of_joints:
            into[COLUMNS[field.name], COLUMNS[field.name]] = joints
    return into, joints.T.copy()


def _prove(data: bytes, policy: Policy, into: NDArray[np.float32], out: NDArray[np.float32]) -> None:
    session = onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"])
    for row in np.random.default_rng(48).normal(size=(32, N_OBSERVATION)).astype(np.float32):
        (theirs,) = session.run([THEIR_OUTPUT], {THEIR_INPUT: row[None]})
        error = float(np.abs(theirs[0] - policy.act(row @ into) @ out).max())
        if not error <= TOLERANCE:
            raise BadInputError(f"the file that was made differs from the policy by {error:g}; allowed: {TOLERANCE:g}")


def _with_metadata(data: bytes, metadata: dict[str, str]) -> bytes:
    model = onnx.load_from_string(data)
    helper.set_model_props(model, metadata)
    written: bytes = model.SerializeToString()
    return written
