"""A foreign network: read, and put between two small maps as one ONNX file with our observation and contract."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
import onnx
import onnxruntime
from google.protobuf.message import DecodeError
from numpy.typing import NDArray
from onnx import TensorProto, compose, helper, numpy_helper
from onnx.external_data_helper import load_external_data_for_model, uses_external_data

from spot_model.errors import BadInputError, SpotRlError
from spot_model.io.yaml_text import FileTooLargeError, read_at_most
from spot_model.policy.contract import INPUT_NAME, MAX_POLICY_BYTES, METADATA_KEY, OUTPUT_NAME, StoredPair
from spot_model.policy.observation import COLUMNS, N_OBSERVATION
from spot_model.policy.policy import Policy, policy_from_bytes
from spot_model.robot import facts
from spot_model.robot.facts import Array
from trainer.foreign.description import (
    JOINT_FIELDS,
    LAST_ACTION,
    ForeignPolicy,
    SeenTerm,
    common_scale,
    foreign_contract,
)
from trainer.foreign.inspection import action_output, check_no_memory, check_normaliser, observation_input

OnnxStep = tuple[str, str, NDArray[Any]]
"""An operator of ONNX, the name of its weight, and the weight."""
_IN_NUMPY: Final = {"MatMul": np.matmul, "Add": np.add, "Mul": np.multiply, "Max": np.maximum, "Min": np.minimum}


def applied(steps: Sequence[OnnxStep], values: Array) -> Array:
    """What steps make of values, shape (..., n)."""
    for operator, _, weight in steps:
        values = np.asarray(_IN_NUMPY[operator](values, weight))
    return values


def observation_steps(policy: ForeignPolicy) -> list[OnnxStep]:
    """From our last ticks, the newest first, shape (..., history · 48), to the foreign observation.

    It is ``scale · clip(ours @ matrix + offset, low, high)``; no clip and no scale where there is none.
    """
    n = policy.width
    matrix, offset = np.zeros((policy.history * N_OBSERVATION, n)), np.zeros((1, n))
    low, high, scale = np.full((1, n), -np.inf), np.full((1, n), np.inf), np.ones((1, n))
    start = 0
    default = dict(zip(policy.joint_names, policy.default_position_rad, strict=True))
    for term in policy.terms:
        for age in term.ages:
            columns = slice(start, start + term.width)
            rows = _rows(term, policy.joint_names) + age * N_OBSERVATION
            matrix[rows, np.arange(columns.start, columns.stop)] = _weights(term, policy)
            if term.is_absolute:
                offset[:, columns] = [default[name] for name in term.joint_names]
            low[:, columns], high[:, columns] = term.clip
            scale[:, columns] = term.scale
            start += term.width
    steps: list[OnnxStep] = [("MatMul", "observation_matrix", matrix), ("Add", "observation_offset", offset)]
    if np.isfinite(low).any() or np.isfinite(high).any():
        bound = np.finfo(np.float32).max
        steps.append(("Max", "observation_low", np.maximum(low, -bound)))
        steps.append(("Min", "observation_high", np.minimum(high, bound)))
    return [*steps, ("Mul", "observation_scale", scale)] if (scale != 1.0).any() else steps


def action_steps(policy: ForeignPolicy) -> list[OnnxStep]:
    """From the foreign action, shape (..., 12), to ours, whose joints share one scale."""
    clip, gain = policy.action_clip, _gain(policy)[None]
    steps: list[OnnxStep] = []
    if np.isfinite(clip):
        steps += [("Max", "action_low", np.array([[-clip]])), ("Min", "action_high", np.array([[clip]]))]
    return [*steps, ("Mul", "joint_gain", gain)]


def _gain(policy: ForeignPolicy) -> Array:
    """Each joint's share of the common scale, shape (12,)."""
    return np.array(policy.action_scale_rad) / common_scale(policy)


def _rows(term: SeenTerm, joint_names: tuple[str, ...]) -> NDArray[np.intp]:
    """Where the term's numbers stand in one tick of our observation."""
    start = COLUMNS[term.field].start
    if term.field not in JOINT_FIELDS:
        return np.arange(start, start + term.width)
    return start + np.array([joint_names.index(name) for name in term.joint_names])


def _weights(term: SeenTerm, policy: ForeignPolicy) -> Array:
    """Our last action is theirs times each joint's share of the common scale; everything else is the same number."""
    if term.field != LAST_ACTION:
        return np.ones(term.width)
    return np.asarray(1.0 / _gain(policy)[[policy.joint_names.index(name) for name in term.joint_names]])


PREFIX: Final = "theirs_"
PROOFS: Final = 64
TOLERANCE: Final = 1e-4
"""Largest difference between the foreign network, asked directly, and the file that is written."""


TORCHSCRIPT: Final = (".pt", ".pth", ".jit", ".torchscript")


def read_network(policy: Path, width: int) -> bytes:
    """An ONNX file's bytes; a TorchScript file is turned into one.

    Args:
        policy: The file.
        width: Numbers that the network sees, by which a TorchScript file is traced.

    Raises:
        BadInputError: It cannot be read, or converted.
    """
    data = policy_bytes(policy)
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
    if not apart <= TOLERANCE:
        raise BadInputError(
            f"TorchScript file {policy} as ONNX gives actions {apart:g} apart, as where the network has a memory; only "
            "networks without memory are run: export ONNX"
        )
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


def policy_bytes(policy: Path) -> bytes:
    """A policy's file, if it is not too large. Raises ``BadInputError`` where it cannot be read."""
    try:
        return read_at_most(policy, MAX_POLICY_BYTES)
    except (OSError, FileTooLargeError) as error:
        raise BadInputError(f"policy {policy} cannot be read: {error}") from error


@contextmanager
def _words_for_the_network() -> Iterator[None]:
    """Our words for what ONNX and ONNX Runtime raise: bare pybind exceptions of many types."""
    try:
        yield
    except SpotRlError:
        raise
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise BadInputError(
            f"the network cannot be run as a policy: {reason}; export it with one float input [1, numbers seen] and "
            f"one output [1, {facts.N_JOINTS}]"
        ) from error


@_words_for_the_network()
def ours_from(network: bytes, policy: ForeignPolicy, *, revision: str) -> Policy:
    """The policy, and in it the file, that our runtime loads.

    Args:
        network: The ONNX file's bytes.
        policy: What the network means.
        revision: Where it came from.

    Raises:
        BadInputError: The network is recurrent, has other shapes than the description, or the file that was made does
            not give the foreign network's actions.
    """
    theirs = onnx.load_from_string(network)
    check_no_memory(theirs.graph)
    source, target = observation_input(theirs, policy), action_output(theirs)
    check_normaliser(theirs.graph, policy.normaliser)
    before, after = observation_steps(policy), action_steps(policy)
    session = onnxruntime.InferenceSession(network, providers=["CPUExecutionProvider"])
    ours = np.random.default_rng(48).normal(size=(PROOFS, policy.history * N_OBSERVATION)).astype(np.float32)
    asked = [
        session.run([target], {source: applied(before, row[None]).astype(np.float32)})[0][0]
        for row in ours.astype(np.float64)
    ]
    if np.shape(asked) != (PROOFS, facts.N_JOINTS) or not np.isfinite(asked).all():
        raise BadInputError(
            f"the network's action {target!r} is not {facts.N_JOINTS} numbers; is it trained, and whole?"
        )
    actions = applied(after, np.array(asked))
    pair = StoredPair(observation=tuple(map(float, ours[0])), action=tuple(map(float, actions[0])))
    metadata = {METADATA_KEY: foreign_contract(policy, pair, revision).to_json()}
    data = surrounded(theirs, (source, target), before, after, (INPUT_NAME, OUTPUT_NAME), metadata)
    made = policy_from_bytes(data, source="the imported policy")
    error = max(float(np.abs(made.act(row) - action).max()) for row, action in zip(ours, actions, strict=True))
    if not error <= TOLERANCE:
        raise BadInputError(f"the file that was made differs from the network by {error:g}; allowed: {TOLERANCE:g}")
    return made


def surrounded(
    inner: onnx.ModelProto,
    ends: tuple[str, str],
    before: Sequence[OnnxStep],
    after: Sequence[OnnxStep],
    names: tuple[str, str],
    metadata: dict[str, str],
) -> bytes:
    """A network between two chains of steps, as one file.

    Args:
        inner: The network.
        ends: Names of its input and of its action.
        before: From the file's input, a row, to the network's.
        after: From the network's action to the file's output.
        names: Of the file's input and output.
        metadata: Of the file.
    """
    graph = compose.add_prefix_graph(inner.graph, PREFIX)
    first = _chain(names[0], before, PREFIX + ends[0])
    last = _chain(PREFIX + ends[1], after, names[1])
    weights = [numpy_helper.from_array(weight.astype(np.float32), name) for _, name, weight in (*before, *after)]
    joined = helper.make_graph(
        [*first, *graph.node, *last],
        "policy",
        [helper.make_tensor_value_info(names[0], TensorProto.FLOAT, [1, len(before[0][2])])],
        [helper.make_tensor_value_info(names[1], TensorProto.FLOAT, [1, facts.N_JOINTS])],
        [*weights, *graph.initializer],
    )
    model = helper.make_model(joined, opset_imports=inner.opset_import, producer_name="spot-rl")
    model.ir_version = min(inner.ir_version, 10)
    for node in model.graph.node:
        node.ClearField("doc_string")
        node.ClearField("metadata_props")
    helper.set_model_props(model, metadata)
    onnx.checker.check_model(model, full_check=True)
    data: bytes = model.SerializeToString()
    return data


def _chain(source: str, steps: Sequence[OnnxStep], out: str) -> list[onnx.NodeProto]:
    """Nodes of one step after the other."""
    nodes, current = [], source
    for i, (operator, name, _) in enumerate(steps):
        result = out if i + 1 == len(steps) else f"{name}_done"
        nodes.append(helper.make_node(operator, [current, name], [result]))
        current = result
    return nodes
