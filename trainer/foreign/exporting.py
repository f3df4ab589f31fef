"""A policy of ours as what other frameworks read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import numpy as np
import onnx
import onnxruntime
from numpy.typing import NDArray

from spot_model.errors import BadInputError
from spot_model.io.whole import check_new, whole_folder
from spot_model.policy.contract import INPUT_NAME, OUTPUT_NAME
from spot_model.policy.observation import COLUMNS, N_OBSERVATION, OBSERVATION
from spot_model.policy.policy import Policy, load_policy
from spot_model.robot.facts import BREADTH_FIRST
from trainer.foreign import mjlab, spot_rl_example
from trainer.foreign.network import OnnxStep, surrounded

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
        metadata = mjlab.metadata_of(policy.contract, policy.contract.training.run)
        files = {out: _network(policy_path, policy, policy.contract.joint_names, metadata)}
    else:
        environment = json.dumps(spot_rl_example.environment_of(policy.contract), indent=2).encode()
        files = {
            out / "policy.onnx": _network(policy_path, policy, BREADTH_FIRST, {}),
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


def _network(path: Path, policy: Policy, joint_names: tuple[str, ...], metadata: dict[str, str]) -> bytes:
    """Our network with their names, and its joints in their order; proved on random inputs."""
    into, out = _permutation(np.array([policy.contract.joint_names.index(name) for name in joint_names]))
    before: list[OnnxStep] = [("MatMul", "to_ours", into)]
    after: list[OnnxStep] = [("MatMul", "to_theirs", out)]
    ends = (INPUT_NAME, OUTPUT_NAME)
    data = surrounded(onnx.load(path), ends, before, after, (THEIR_INPUT, THEIR_OUTPUT), metadata)
    session = onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"])
    for row in np.random.default_rng(48).normal(size=(32, N_OBSERVATION)).astype(np.float32):
        (theirs,) = session.run([THEIR_OUTPUT], {THEIR_INPUT: row[None]})
        error = float(np.abs(theirs[0] - policy.act(row @ into) @ out).max())
        if not error <= TOLERANCE:
            raise BadInputError(f"the file that was made differs from the policy by {error:g}; allowed: {TOLERANCE:g}")
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
