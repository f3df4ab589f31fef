"""The walk over an ONNX file's bytes: it finds what ONNX itself finds, and refuses what no policy needs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from spot_model.policy.contract import METADATA_KEY, PolicyError
from spot_model.policy.onnx_head import OnnxHeadError, read_head
from spot_model.policy.policy import policy_from_bytes

POLICIES = Path(__file__).resolve().parents[2] / "policies"


def model_of(*nodes: onnx.NodeProto, initializers: tuple[TensorProto, ...] = ()) -> onnx.ModelProto:
    """A model of these nodes."""
    value = helper.make_tensor_value_info("x", TensorProto.FLOAT, [1, 2])
    graph = helper.make_graph(list(nodes), "g", [value], [value], initializer=list(initializers))
    return helper.make_model(graph)


@pytest.mark.parametrize("file", sorted(POLICIES.glob("*.onnx")), ids=lambda path: path.stem)
def test_it_finds_what_onnx_finds(file: Path) -> None:
    model = onnx.load(file)
    head = read_head(file.read_bytes())
    assert head.metadata == {entry.key: entry.value for entry in model.metadata_props}
    assert METADATA_KEY in head.metadata
    assert head.nodes == len(model.graph.node)


def test_weights_in_another_file_are_refused() -> None:
    weights = numpy_helper.from_array(np.zeros((2, 2), dtype=np.float32), "w")
    weights.ClearField("raw_data")
    weights.data_location = TensorProto.EXTERNAL
    weights.external_data.add(key="location", value="../../etc/passwd")
    assert read_head(model_of(initializers=()).SerializeToString()).nodes == 0
    for model in (
        model_of(initializers=(weights,)),
        model_of(helper.make_node("Constant", [], ["w"], value=weights)),
    ):
        with pytest.raises(OnnxHeadError, match="weights in another file"):
            read_head(model.SerializeToString())


def test_operators_of_unknown_cost_and_origin_are_refused() -> None:
    inner = helper.make_graph([], "inner", [], [])
    for node, words in (
        (helper.make_node("Loop", ["x"], ["y"]), "operator Loop"),
        (helper.make_node("If", ["x"], ["y"], then_branch=inner, else_branch=inner), "operator If|graph in a graph"),
        (helper.make_node("Anything", ["x"], ["y"], body=inner), "graph in a graph"),
        (helper.make_node("Gelu", ["x"], ["y"], domain="com.example"), "domain 'com.example'"),
    ):
        with pytest.raises(OnnxHeadError, match=words):
            read_head(model_of(node).SerializeToString())
    with_function = model_of()
    with_function.functions.append(helper.make_function("custom", "F", ["x"], ["y"], [], [helper.make_opsetid("", 17)]))
    with pytest.raises(OnnxHeadError, match="functions of its own"):
        read_head(with_function.SerializeToString())


def test_every_cut_is_refused_or_still_a_message() -> None:
    data = model_of(helper.make_node("Relu", ["x"], ["x"])).SerializeToString()
    assert read_head(data).nodes == 1

    def is_refused(cut: bytes) -> bool:
        try:
            read_head(cut)
        except OnnxHeadError:
            return True
        return False

    assert sum(is_refused(data[:end]) for end in range(len(data))) > len(data) // 2


@pytest.mark.parametrize("data", [b"", b"\x00", b"\xff" * 20, b"\x3a\x7f", b"\x3b", b"\x72\x02\x0a\xff", bytes(1000)])
def test_what_is_no_model_is_refused_in_words(data: bytes) -> None:
    with pytest.raises(PolicyError, match=r"is no readable ONNX model: .*export it again"):
        policy_from_bytes(data, source="x.onnx")
