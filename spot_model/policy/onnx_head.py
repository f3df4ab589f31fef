"""What an ONNX file says about itself, read before ONNX Runtime sees a byte of it.

An ONNX file is a protobuf message; its tags and lengths are walked here, and nothing is computed, allocated by the
file's word, or fetched. So only a file whose contract holds reaches native code, and one that would fetch weights from
other files, loop, or bring functions of its own never does.

Numbers of fields: onnx.proto of ONNX 1.x (ModelProto, GraphProto, NodeProto, AttributeProto, TensorProto).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

MODEL_GRAPH: Final = 7
MODEL_METADATA: Final = 14
MODEL_FUNCTIONS: Final = 25
GRAPH_NODE: Final = 1
GRAPH_INITIALIZER: Final = 5
GRAPH_SPARSE_INITIALIZER: Final = 15
NODE_OPERATOR: Final = 4
NODE_ATTRIBUTE: Final = 5
NODE_DOMAIN: Final = 7
ATTRIBUTE_TENSOR: Final = 5
ATTRIBUTE_GRAPH: Final = 6
ATTRIBUTE_TENSORS: Final = 10
ATTRIBUTE_GRAPHS: Final = 11
TENSOR_LOCATION: Final = 14
TENSOR_EXTERNAL: Final = 13

MAX_NODES: Final = 10_000
FORBIDDEN: Final = frozenset({"Loop", "Scan", "If", "SequenceMap"})
"""Operators whose cost the file does not tell."""

_DOMAINS: Final = frozenset({"", "ai.onnx"})


class OnnxHeadError(ValueError):
    """The bytes are no ONNX model that is taken here; the message says why."""


@dataclass(frozen=True)
class OnnxHead:
    """What was found."""

    metadata: dict[str, str]
    nodes: int


def read_head(data: bytes) -> OnnxHead:
    """Walk a model's bytes.

    Raises:
        OnnxHeadError: It is no protobuf message with a graph, or it holds what no policy needs.
    """
    metadata: dict[str, str] = {}
    nodes, graphs = 0, 0
    for number, value in _fields(data, 0, len(data)):
        if number == MODEL_METADATA:
            key, text = _pair(data, value)
            metadata[key] = text
        elif number == MODEL_GRAPH:
            graphs += 1
            nodes += _check_graph(data, value)
        elif number == MODEL_FUNCTIONS:
            raise OnnxHeadError("it brings functions of its own; export it with standard operators alone")
    if graphs != 1:
        raise OnnxHeadError(f"it holds {graphs} graphs; a model has one")
    return OnnxHead(metadata, nodes)


def _check_graph(data: bytes, at: slice) -> int:
    nodes = 0
    for number, value in _fields(data, at.start, at.stop):
        if number == GRAPH_NODE:
            nodes += 1
            if nodes > MAX_NODES:
                raise OnnxHeadError(f"it has more than {MAX_NODES} nodes")
            _check_node(data, value)
        elif number == GRAPH_INITIALIZER:
            _check_tensor(data, value)
        elif number == GRAPH_SPARSE_INITIALIZER:
            raise OnnxHeadError("it has sparse weights; export them dense")
    return nodes


def _check_node(data: bytes, at: slice) -> None:
    for number, value in _fields(data, at.start, at.stop):
        if number == NODE_OPERATOR and _text(data, value) in FORBIDDEN:
            raise OnnxHeadError(f"operator {_text(data, value)} has a cost that nobody knows; export it without")
        if number == NODE_DOMAIN and _text(data, value) not in _DOMAINS:
            raise OnnxHeadError(f"operators of domain {_text(data, value)[:40]!r} are not taken; use standard ones")
        if number == NODE_ATTRIBUTE:
            _check_attribute(data, value)


def _check_attribute(data: bytes, at: slice) -> None:
    for number, value in _fields(data, at.start, at.stop):
        if number in (ATTRIBUTE_GRAPH, ATTRIBUTE_GRAPHS):
            raise OnnxHeadError("it holds a graph in a graph; export it flat")
        if number in (ATTRIBUTE_TENSOR, ATTRIBUTE_TENSORS):
            _check_tensor(data, value)


def _check_tensor(data: bytes, at: slice) -> None:
    for number, value in _fields(data, at.start, at.stop):
        is_elsewhere = number == TENSOR_LOCATION and value.stop - value.start == 1 and data[value.start] == 1
        if is_elsewhere or number == TENSOR_EXTERNAL:
            raise OnnxHeadError("it keeps weights in another file; export it as one file")


def _pair(data: bytes, at: slice) -> tuple[str, str]:
    found = {1: "", 2: ""}
    for number, value in _fields(data, at.start, at.stop):
        if number in found:
            found[number] = _text(data, value)
    return found[1], found[2]


def _text(data: bytes, at: slice) -> str:
    try:
        return data[at].decode("utf-8")
    except UnicodeDecodeError as error:
        raise OnnxHeadError(f"a name at byte {at.start} is no text") from error


def _fields(data: bytes, at: int, end: int) -> Iterator[tuple[int, slice]]:
    """Each field's number, and where its value lies."""
    while at < end:
        key, at = _varint(data, at, end)
        number, wire = key >> 3, key & 7
        start = at
        if wire == 0:
            _, at = _varint(data, at, end)
        elif wire == 1:
            at += 8
        elif wire == 5:
            at += 4
        elif wire == 2:
            size, start = _varint(data, at, end)
            at = start + size
        else:
            raise OnnxHeadError(f"byte {start} is not what a protobuf message holds there")
        if number == 0 or at > end:
            raise OnnxHeadError(f"a field at byte {start} goes beyond its message's end")
        yield number, slice(start, at)


def _varint(data: bytes, at: int, end: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if at >= end:
            raise OnnxHeadError("it is cut")
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
    raise OnnxHeadError(f"a number before byte {at} has no end")
