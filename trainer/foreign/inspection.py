"""What a foreign network's graph tells before it is run: whether it has a memory or a normaliser, and its two ends."""

from __future__ import annotations

from typing import Final

import numpy as np
import onnx
from onnx import numpy_helper

from spot_model.errors import BadInputError
from spot_model.robot import facts
from trainer.foreign.description import ForeignPolicy

_RECURRENT: Final = frozenset({"LSTM", "GRU", "RNN"})
_SCALES: Final = frozenset({"Add", "Sub", "Mul", "Div", "BatchNormalization"})
_MIXES: Final = frozenset({"Gemm", "MatMul", "Conv"})
_CONSTANT: Final = ("Constant", "value")
_ACTIONS: Final = frozenset({"actions", "action", "output", "mu"})


def check_no_memory(graph: onnx.GraphProto) -> None:
    """Raise ``BadInputError`` for a recurrent operator, whose state would begin anew at every tick."""
    for node in graph.node:
        if node.op_type in _RECURRENT:
            raise BadInputError(
                f"the network is recurrent (operator {node.op_type}); only those without memory are run"
            )
        for attribute in node.attribute:
            check_no_memory(attribute.g)


def check_normaliser(graph: onnx.GraphProto, told: str) -> None:
    """Refuse a network without the normaliser that the learner's file tells of (``told``, empty where it does not)."""
    if told and not _has_normaliser(graph):
        raise BadInputError(
            f"agent.yaml says that the observation was normalised ({told}), and the network, before its first layer, "
            "does not; export it together with the normaliser, or set this key to false if that layer contains it"
        )


def _has_normaliser(graph: onnx.GraphProto) -> bool:
    """Whether numbers meet each a mean or deviation of its own before the first layer mixes them."""
    constants = {tensor.name: tensor for tensor in graph.initializer}
    constants |= {n.output[0]: a.t for n in graph.node for a in n.attribute if (n.op_type, a.name) == _CONSTANT}
    for node in graph.node:  # in the order of computation, as ONNX demands
        known = [numpy_helper.to_array(constants[name]) for name in node.input if name in constants]
        if node.op_type in _MIXES:
            return False
        if node.op_type in _SCALES and any(value.size and np.ptp(value) > 0.0 for value in known):
            return True
    return False


def action_output(model: onnx.ModelProto) -> str:
    """The output that is the action: the only one of twelve numbers, or the only such one with a usual name."""
    widths = {value.name: _width(value) for value in model.graph.output}
    fitting = [name for name, width in widths.items() if width in (facts.N_JOINTS, 0)]
    chosen = fitting if len(fitting) == 1 else [name for name in fitting if name in _ACTIONS]
    if len(chosen) != 1:
        told = ", ".join(f"{name} of {width} numbers" for name, width in widths.items()) or "none"
        raise BadInputError(
            f"the network has outputs: {told}; export it with the one of {facts.N_JOINTS} that is the action alone, or "
            "with the name 'actions'"
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
