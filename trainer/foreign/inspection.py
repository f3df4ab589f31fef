"""What a foreign network's graph tells before it is run: whether it has a memory or a normaliser, and its two ends."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
import onnx
from onnx import numpy_helper

from spot_model.errors import BadInputError
from spot_model.robot import facts
from trainer.foreign.description import ForeignPolicy

_RECURRENT: Final = frozenset({"LSTM", "GRU", "RNN"})
_SCALES: Final = frozenset({"Add", "Sub", "Mul", "Div", "BatchNormalization"})
_PASSES: Final = frozenset(
    {"Cast", "Clip", "Concat", "Flatten", "Gather", "Identity", "Max", "Min", "Reshape", "Slice", "Split", "Squeeze"}
    | {"Transpose", "Unsqueeze"}
)
"""Operators that leave each number by itself."""
_ACTIONS: Final = frozenset({"actions", "action", "output", "mu"})


def check_no_memory(model: onnx.ModelProto) -> None:
    """Raise ``BadInputError`` for a recurrent operator, whose state would begin anew at every tick."""
    nodes = (*_nodes(model.graph.node), *(n for function in model.functions for n in _nodes(function.node)))
    found = sorted({node.op_type for node in nodes} & _RECURRENT)
    if found:
        raise BadInputError(
            f"the network is recurrent (operator {', '.join(found)}); only networks without memory are run: train one "
            "that sees a history of ticks"
        )


def check_normaliser(model: onnx.ModelProto, source: str, told: str) -> None:
    """Refuse a network without the normaliser that the learner's file tells of (``told``, empty where it does not)."""
    if told and not _has_normaliser(model.graph, source):
        raise BadInputError(
            f"agent.yaml says that the observation was normalised ({told}), and the network, before its first layer, "
            "shifts or scales none of its inputs by a number of its own; export it together with the normaliser. If "
            "its first layer contains that already, set this key to false"
        )


def _has_normaliser(graph: onnx.GraphProto, source: str) -> bool:
    """Whether each number of the observation meets its own mean or deviation before the first layer mixes them."""
    constants = {tensor.name: tensor for tensor in graph.initializer}
    constants |= {n.output[0]: n.attribute[0].t for n in graph.node if n.op_type == "Constant" and n.attribute}
    reached = {source}
    for node in graph.node:  # in the order of computation, as ONNX demands
        others = [name for name in node.input if name not in reached]
        if len(others) == len(node.input):
            continue
        known = [numpy_helper.to_array(constants[name]) for name in others if name in constants]
        if node.op_type in _SCALES and any(np.ptp(value) > 0.0 for value in known if value.size):
            return True
        if node.op_type in _PASSES or (node.op_type in _SCALES and len(known) == len(others)):
            reached |= set(node.output)
    return False


def action_output(model: onnx.ModelProto, wanted: str) -> str:
    """The output that is the action: the one that was asked for, the only one, or the only one with a usual name.

    Raises:
        BadInputError: Nothing tells which it is, or it has not a number for each joint.
    """
    widths = {value.name: _width(value) for value in model.graph.output}
    usual = [name for name in widths if len(widths) == 1 or name in _ACTIONS]
    chosen = [wanted] if wanted in widths else [] if wanted else usual
    if len(chosen) != 1:
        raise BadInputError(
            f"the network has outputs {', '.join(widths) or 'none'}"
            f"{f', and none is {wanted}' if wanted else ''}; name the action's with --action-output"
        )
    if widths[chosen[0]] not in (facts.N_JOINTS, 0):
        raise BadInputError(
            f"the network's output {chosen[0]!r} has {widths[chosen[0]]} numbers; {facts.N_JOINTS} joints are moved"
        )
    return chosen[0]


def observation_input(model: onnx.ModelProto, policy: ForeignPolicy) -> str:
    """Name of the network's one input, if it is as wide as the policy's terms."""
    weights = {tensor.name for tensor in model.graph.initializer}
    inputs = [value for value in model.graph.input if value.name not in weights]
    if len(inputs) != 1:
        raise BadInputError(
            f"the network has inputs {', '.join(v.name for v in inputs) or 'none'}; allowed: one, the observation. "
            "A recurrent network, or one with a clock, is not run"
        )
    width = _width(inputs[0])
    if width != policy.width:
        raise BadInputError(
            f"the network sees {width} numbers, and its terms have {policy.width}: "
            f"{', '.join(f'{t.field} {t.width}×{len(t.ages)}' for t in policy.terms)}; the side file is another run's"
        )
    return inputs[0].name


def _width(value: onnx.ValueInfoProto) -> int:
    shape = value.type.tensor_type.shape.dim
    return int(shape[-1].dim_value) if shape else 0


def _nodes(nodes: object) -> Iterator[onnx.NodeProto]:
    """Operators, and those of the graphs that loops and branches hold."""
    for node in nodes:  # type: ignore[attr-defined]
        yield node
        for attribute in node.attribute:
            yield from _nodes(attribute.g.node)
