"""The walk over an ONNX file's bytes: it finds what ONNX itself finds, and refuses what no policy needs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
from google.protobuf.message import DecodeError
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


# Files written by somebody who knows how the readers differ -----------------------------------------------------------


def varint(value: int) -> bytes:
    out = b""
    while value >= 0x80:
        out, value = out + bytes([value & 0x7F | 0x80]), value >> 7
    return out + bytes([value])


def bytes_field(number: int, content: bytes, *, high: int = 0) -> bytes:
    """A length-delimited field; ``high`` is added to its tag, above the 32 bits that protobuf keeps."""
    return varint((number << 3 | 2) + high) + varint(len(content)) + content


def hidden_loop(high: int) -> bytes:
    """A model whose node is a Loop, in a field that a reader of long tags takes for another."""
    loop = helper.make_node("Loop", ["x"], ["y"], body=helper.make_graph([], "inner", [], [])).SerializeToString()
    whole = model_of()
    graph = whole.graph.SerializeToString() + bytes_field(1, loop, high=high)
    whole.ClearField("graph")
    return whole.SerializeToString() + bytes_field(7, graph)


def test_a_tag_beyond_32_bits_hides_nothing() -> None:
    with pytest.raises(OnnxHeadError, match=r"operator Loop|graph in a graph"):
        read_head(hidden_loop(0))
    for bit in range(32, 64):
        with pytest.raises(OnnxHeadError, match="names no field"):
            read_head(hidden_loop(1 << bit))


@pytest.mark.parametrize(
    ("tensor", "words"),
    [
        (b"\x70\x01", "weights in another file"),
        (b"\x70\x81\x00", "shortest way"),
        (b"\x70" + varint((1 << 32) + 1), "weights in another file"),
        (b"\x70\x00\x70\x01", "comes twice"),
        (b"\x72\x01\x01", "not of its type"),
        (bytes_field(13, b""), "weights in another file"),
        (bytes_field(99, b""), "field 99"),
        (b"\x6b\x6c", "not what a protobuf message holds"),
    ],
    ids=["plain", "long", "cut to 32 bits", "twice", "other type", "external", "unknown", "group"],
)
def test_the_place_of_weights_is_read_one_way(tensor: bytes, words: str) -> None:
    graph = model_of().graph.SerializeToString() + bytes_field(5, tensor)
    with pytest.raises(OnnxHeadError, match=words):
        read_head(bytes_field(7, graph))


def test_two_graphs_and_two_contracts_are_refused() -> None:
    graph = bytes_field(7, model_of().graph.SerializeToString())
    with pytest.raises(OnnxHeadError, match="comes twice"):
        read_head(graph + graph)
    entry = bytes_field(14, bytes_field(1, b"key") + bytes_field(2, b"value"))
    with pytest.raises(OnnxHeadError, match="'key' twice"):
        read_head(graph + entry + entry)


@pytest.mark.parametrize("file", sorted(POLICIES.glob("*.onnx")), ids=lambda path: path.stem)
def test_what_is_taken_is_what_onnx_and_its_runtime_see(file: Path) -> None:
    """Every byte of the head changed in turn: taken models have the operators and the metadata that others read."""
    whole = file.read_bytes()
    rng, taken = np.random.default_rng(5), 0
    for _ in range(400):
        data = bytearray(whole)
        at = int(rng.integers(len(data) - 3000, len(data)) if rng.random() < 0.5 else rng.integers(0, 3000))
        data[at] = rng.integers(0, 256)
        try:
            head = read_head(bytes(data))
            model = onnx.ModelProto.FromString(bytes(data))
        except (OnnxHeadError, DecodeError):  # whatever either refuses is not run
            continue
        taken += 1
        assert head.operators == [node.op_type for node in model.graph.node]
        assert head.metadata == {entry.key: entry.value for entry in model.metadata_props}
    assert taken > 10
