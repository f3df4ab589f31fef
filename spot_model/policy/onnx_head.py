"""The head of an ONNX file, checked before ONNX Runtime reads the file.

An ONNX file is a protobuf message. It is walked here by a table of all that a policy may hold, and nothing is computed,
allocated by the file's word, or fetched. A field that the table does not know is refused, not skipped: so this reader
and ONNX Runtime's cannot see two different models in one file, and none that would loop, fetch weights from other
files, or bring functions of its own reaches native code.

Protobuf's own readers are lenient in ways that differ between languages: tags are cut to 32 bits, a number may be
written longer than it needs to be, a single field may come twice and is then merged. What is not written the plain way
is refused here, so that all readers see the same.

Numbers of fields: onnx.proto of ONNX 1.x.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5
MAX_TAG: Final = (1 << 32) - 1
_SIZES: Final = {FIXED64: 8, FIXED32: 4}


class WireError(ValueError):
    """The bytes are not a plainly written protobuf message; the message says why."""


class Field(NamedTuple):
    """One field: its number, its wire type, where its value lies, and the value itself if it is a varint."""

    number: int
    wire: int
    at: slice
    value: int


def fields(data: bytes, at: slice) -> Iterator[Field]:
    """Each field of the message that lies in ``data[at]``, in order. Raises WireError."""
    position, end = at.start, at.stop
    while position < end:
        tag, start = _varint(data, position, end)
        number, wire, value, stop = tag >> 3, tag & 7, 0, end + 1
        if tag > MAX_TAG or number == 0:
            raise WireError(f"the tag at byte {position} names no field")
        if wire == VARINT:
            value, stop = _varint(data, start, end)
        elif wire == BYTES:
            size, start = _varint(data, start, end)
            stop = start + size
        elif wire in _SIZES:
            stop = start + _SIZES[wire]
        else:
            raise WireError(f"byte {position} is not what a protobuf message holds there")
        if stop > end:
            raise WireError(f"a field at byte {position} goes beyond its message's end")
        yield Field(number, wire, slice(start, stop), value)
        position = stop


def _varint(data: bytes, at: int, end: int) -> tuple[int, int]:
    value = 0
    for index in range(10):
        if at + index >= end:
            raise WireError("it is cut")
        byte = data[at + index]
        value |= (byte & 0x7F) << (7 * index)
        if byte < 0x80:
            if value >= 1 << 64 or (byte == 0 and index):
                raise WireError(f"the number at byte {at} is not written the shortest way")
            return value, at + index + 1
    raise WireError(f"the number at byte {at} has no end")


MAX_NODES: Final = 10_000
FORBIDDEN: Final = frozenset({"Loop", "Scan", "If", "SequenceMap"})
"""Operators whose cost the file does not tell."""

_DOMAINS: Final = frozenset({"", "ai.onnx"})


class OnnxHeadError(ValueError):
    """The bytes are not an ONNX model that is accepted here; the message says why."""


@dataclass
class OnnxHead:
    """What was found."""

    metadata: dict[str, str] = field(default_factory=dict)
    operators: list[str] = field(default_factory=list)
    """Operators of all nodes, in the order of the file."""

    @property
    def nodes(self) -> int:
        """How many nodes there are."""
        return len(self.operators)


class _Rule(NamedTuple):
    """How a field may be written: its wire types, the message that it holds, and whether it may come twice."""

    wires: tuple[int, ...]
    kind: str = ""
    is_repeated: bool = False


_NUMBER, _TEXT, _TEXTS = _Rule((VARINT,)), _Rule((BYTES,)), _Rule((BYTES,), is_repeated=True)
_NUMBERS = _Rule((VARINT, BYTES), is_repeated=True)


def _one(kind: str) -> _Rule:
    return _Rule((BYTES,), kind)


def _many(kind: str) -> _Rule:
    return _Rule((BYTES,), kind, is_repeated=True)


_GRAMMAR: Final[dict[str, dict[int, _Rule]]] = {
    "model": {
        1: _NUMBER,
        2: _TEXT,
        3: _TEXT,
        4: _TEXT,
        5: _NUMBER,
        6: _TEXT,
        7: _one("graph"),
        8: _many("operator set"),
        14: _many("metadata"),
    },
    "operator set": {1: _TEXT, 2: _NUMBER},
    "metadata": {1: _TEXT, 2: _TEXT},
    "entry": {1: _TEXT, 2: _TEXT},
    "graph": {
        1: _many("node"),
        2: _TEXT,
        5: _many("tensor"),
        10: _TEXT,
        11: _many("value"),
        12: _many("value"),
        13: _many("value"),
        16: _many("entry"),
    },
    "node": {1: _TEXTS, 2: _TEXTS, 3: _TEXT, 4: _TEXT, 5: _many("attribute"), 6: _TEXT, 7: _TEXT, 9: _many("entry")},
    "attribute": {
        1: _TEXT,
        2: _Rule((FIXED32,)),
        3: _NUMBER,
        4: _TEXT,
        5: _one("tensor"),
        7: _Rule((FIXED32, BYTES), is_repeated=True),
        8: _NUMBERS,
        9: _TEXTS,
        10: _many("tensor"),
        13: _TEXT,
        20: _NUMBER,
    },
    "tensor": {
        1: _NUMBERS,
        2: _NUMBER,
        4: _Rule((FIXED32, BYTES), is_repeated=True),
        5: _NUMBERS,
        6: _TEXTS,
        7: _NUMBERS,
        8: _TEXT,
        9: _TEXT,
        10: _Rule((FIXED64, BYTES), is_repeated=True),
        11: _NUMBERS,
        12: _TEXT,
        14: _NUMBER,
        16: _many("entry"),
    },
    "value": {1: _TEXT, 2: _one("type"), 3: _TEXT, 4: _many("entry")},
    "type": {1: _one("tensor type"), 6: _TEXT},
    "tensor type": {1: _NUMBER, 2: _one("shape")},
    "shape": {1: _many("dimension")},
    "dimension": {1: _NUMBER, 2: _TEXT, 3: _TEXT},
}

_ELSEWHERE: Final = "it keeps weights in another file; export it as one file"
_NESTED: Final = "it holds a graph in a graph; export it flat"
_REFUSED: Final = {
    ("model", 20): "it brings a training procedure; export it for inference",
    ("model", 25): "it brings functions of its own; export it with standard operators alone",
    ("graph", 15): "it has sparse weights; export them dense",
    ("attribute", 6): _NESTED,
    ("attribute", 11): _NESTED,
    ("attribute", 22): "it has sparse weights; export them dense",
    ("attribute", 23): "it has sparse weights; export them dense",
    ("tensor", 13): _ELSEWHERE,
}
"""What ONNX knows and no policy needs."""


def read_head(data: bytes) -> OnnxHead:
    """Walk a model's bytes.

    Raises:
        OnnxHeadError: It is not a protobuf message with a graph, or holds what no policy needs.
    """
    head = OnnxHead()
    try:
        found = _walk(data, "model", slice(0, len(data)), head)
    except WireError as error:
        raise OnnxHeadError(str(error)) from error
    if 7 not in found:
        raise OnnxHeadError("it holds 0 graphs; a model has one")
    return head


def _walk(data: bytes, kind: str, at: slice, head: OnnxHead) -> dict[int, Field]:
    """Check one message and all that it holds. Returns its fields by number, the last of each."""
    found: dict[int, Field] = {}
    rules = _GRAMMAR[kind]
    for item in fields(data, at):
        rule = rules.get(item.number)
        if rule is None:
            words = f"its {kind} at byte {at.start} has a field {item.number}, which an ONNX policy does not have"
            raise OnnxHeadError(_REFUSED.get((kind, item.number), words))
        if item.wire not in rule.wires:
            raise OnnxHeadError(f"field {item.number} of its {kind} at byte {at.start} is not of its type")
        if item.number in found and not rule.is_repeated:
            raise OnnxHeadError(f"field {item.number} of its {kind} at byte {at.start} comes twice")
        found[item.number] = item
        if rule.kind:
            _judge(data, rule.kind, _walk(data, rule.kind, item.at, head), head)
    return found


def _judge(data: bytes, kind: str, found: dict[int, Field], head: OnnxHead) -> None:
    """Refuse a message by what it says; take what the head tells."""
    if kind == "metadata":
        key = _text(data, found.get(1))
        if key in head.metadata:
            raise OnnxHeadError(f"its metadata holds {key[:40]!r} twice")
        head.metadata[key] = _text(data, found.get(2))
    elif kind == "tensor" and 14 in found and found[14].value != 0:
        raise OnnxHeadError(_ELSEWHERE)
    elif kind == "operator set":
        _check_domain(_text(data, found.get(1)))
    elif kind == "node":
        operator = _text(data, found.get(4))
        if operator in FORBIDDEN:
            raise OnnxHeadError(f"operator {operator} has a cost that nobody knows; export it without")
        _check_domain(_text(data, found.get(7)))
        head.operators.append(operator)
        if head.nodes > MAX_NODES:
            raise OnnxHeadError(f"it has more than {MAX_NODES} nodes")


def _check_domain(domain: str) -> None:
    if domain not in _DOMAINS:
        raise OnnxHeadError(f"operators of domain {domain[:40]!r} are not taken; use standard ones")


def _text(data: bytes, item: Field | None) -> str:
    if item is None:
        return ""
    try:
        return data[item.at].decode("utf-8")
    except UnicodeDecodeError as error:
        raise OnnxHeadError(f"a name at byte {item.at.start} is no text") from error
