"""The columns of a table from many protobuf messages, or straight from their wire bytes.

Most messages of a topic have their values at the same places in their bytes. Such a layout is read off one message, and
holds for another of the same length whose tags, lengths and ends of numbers are the same; then its values are there,
too, and no object a message is made. Whatever has an unusual layout is left to protobuf.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, Final, TypeVar

import numpy as np
from google.protobuf.descriptor import FieldDescriptor
from numpy.typing import NDArray

from spot_log.errors import LogReadError
from spot_log.format.tables import Column, Table, width_of

Messages = Sequence[Any]
TableT = TypeVar("TableT", bound=Table)


def gather(kind: type[TableT], messages: Messages, widths: Mapping[str, int], **given: Any) -> TableT:
    """A table of messages whose fields are named as its columns.

    Raises:
        LogReadError: A message holds an array of another length.
    """
    columns = {n: _gathered(messages, n, c, widths) for n, c in kind.columns().items() if n not in given}
    return kind(**columns, **given)


def _gathered(messages: Messages, name: str, declared: Column, widths: Mapping[str, int]) -> NDArray[Any]:
    """One column; an empty array becomes a row of NaN, and booleans of which no message has any have no columns."""
    width, dtype = width_of(declared, widths), declared.dtype
    rows = [getattr(message, name) for message in messages]
    if width is None:
        return np.array(rows, dtype=dtype)
    is_flags = dtype.kind == "b"
    if is_flags and not any(map(len, rows)):
        return np.zeros((len(rows), 0), dtype=dtype)
    if all(len(row) == width for row in rows):
        return np.array(list(chain.from_iterable(rows)), dtype=dtype).reshape(len(rows), width)
    for row, values in enumerate(rows):
        if len(values) != width and (is_flags or len(values)):
            raise LogReadError(f"log record {name}: row {row} has {len(values)} values, expected {width}")
    return np.array([list(values) or [np.nan] * width for values in rows], dtype=dtype)


def widest(messages: Messages, name: str) -> int:
    """Length of the longest array of that name; 0 where there is none."""
    return max((len(getattr(message, name)) for message in messages), default=0)


_INT, _BYTES = 0, 2
_ARRAYS: Final[dict[int, np.dtype[Any]]] = {
    FieldDescriptor.TYPE_DOUBLE: np.dtype("<f8"),
    FieldDescriptor.TYPE_FLOAT: np.dtype("<f4"),
    FieldDescriptor.TYPE_BOOL: np.dtype("u1"),
}
_INT_BYTES: Final[dict[int, int]] = {
    FieldDescriptor.TYPE_INT64: 10,
    FieldDescriptor.TYPE_UINT64: 10,
    FieldDescriptor.TYPE_UINT32: 4,
}
MAX_LAYOUTS: Final = 100
"""Layouts of one topic that are remembered; a topic with more is left to protobuf."""

Values = dict[str, NDArray[Any]]


class UnusualError(Exception):
    """A message is not written as the log's own writer does."""


@dataclass
class Layout:
    """Where a message's values stand in its bytes."""

    ints: dict[str, slice] = field(default_factory=dict)
    arrays: dict[str, tuple[slice, np.dtype[Any]]] = field(default_factory=dict)
    parts: dict[str, list[Layout]] = field(default_factory=dict)
    """Messages within."""
    structure: list[int] = field(default_factory=list)
    """Bytes that hold no values: tags and lengths."""

    def everything(self) -> list[Layout]:
        """This layout, and those of the messages within."""
        return [self, *(one for parts in self.parts.values() for part in parts for one in part.everything())]


def layout_of(data: bytes, kind: Any, at: int, end: int) -> Layout:
    """The layout of the message in ``data[at:end]``, whose descriptor is ``kind``.

    Raises:
        UnusualError: A field is unknown, of a kind that is not for tables, or comes twice.
    """
    layout = Layout()
    while at < end:
        begin = at
        tag, at = _int(data, at, end)
        declared = kind.fields_by_number.get(tag >> 3)
        if declared is None or declared.name in layout.ints or declared.name in layout.arrays:
            raise UnusualError
        if tag & 7 == _INT and declared.type in _INT_BYTES and not declared.is_repeated:
            layout.structure += range(begin, at)
            _, stop = _int(data, at, end)
            if stop - at > _INT_BYTES[declared.type]:
                raise UnusualError
            layout.ints[declared.name] = slice(at, stop)
        elif tag & 7 == _BYTES and declared.is_repeated:
            length, at = _int(data, at, end)
            stop = at + length
            layout.structure += range(begin, at)
            if stop > end:
                raise UnusualError
            if declared.message_type is not None:
                part = layout_of(data, declared.message_type, at, stop)
                layout.parts.setdefault(declared.name, []).append(part)
            elif declared.type in _ARRAYS and length % _ARRAYS[declared.type].itemsize == 0:
                layout.arrays[declared.name] = slice(at, stop), _ARRAYS[declared.type]
            else:
                raise UnusualError
        else:
            raise UnusualError
        at = stop
    return layout


def _int(data: bytes, at: int, end: int) -> tuple[int, int]:
    """A number of base 128, and where it ends."""
    value = 0
    for i in range(10):
        if at + i >= end:
            break
        value |= (data[at + i] & 0x7F) << 7 * i
        if data[at + i] < 0x80:
            return value, at + i + 1
    raise UnusualError


def rows_like(rows: NDArray[np.uint8], layout: Layout) -> NDArray[np.bool_]:
    """Which messages, shape (n, bytes), have the layout of the first one, and flags of 0 or 1."""
    layouts = layout.everything()
    same = [i for one in layouts for i in one.structure]
    ints = [i for one in layouts for part in one.ints.values() for i in range(part.start, part.stop)]
    flags = [i for one in layouts for p, t in one.arrays.values() if t.kind == "u" for i in range(p.start, p.stop)]
    like = (rows[:, same] == rows[0, same]).all(axis=1)
    like &= ((rows[:, ints] ^ rows[0, ints]) < 0x80).all(axis=1)
    return np.asarray(like & (rows[:, flags] <= 1).all(axis=1))


def values_of(rows: NDArray[np.uint8], layout: Layout, kind: type[Table], widths: Mapping[str, int]) -> Values:
    """The columns of messages of one layout.

    Raises:
        UnusualError: An array is not as wide as its column.
    """
    values: Values = {}
    for name, declared in kind.columns().items():
        width = width_of(declared, widths)
        if width is None:
            part = rows[:, layout.ints.get(name, slice(0, 0))].astype(np.uint64) & np.uint64(0x7F)
            shifted = part << (np.uint64(7) * np.arange(part.shape[1], dtype=np.uint64))
            values[name] = np.bitwise_or.reduce(shifted, axis=1).view(np.int64)
        else:
            where, dtype = layout.arrays.get(name, (slice(0, 0), np.dtype("u1")))
            found = np.ascontiguousarray(rows[:, where]).view(dtype)
            if found.shape[1] != width:
                raise UnusualError
            values[name] = found.astype(declared.dtype)
    return values


def wire_columns(
    raws: Sequence[bytes], message: Any, kind: type[Table], widths: Mapping[str, int], part: str, of: type[Table]
) -> tuple[Values, Values, NDArray[np.int64]]:
    """The columns of messages, and of the messages that stand in their field ``part``.

    Args:
        raws: Wire bytes, one a row.
        message: Their descriptor.
        kind: The table whose columns are wanted; those that the messages do not hold come out as 0.
        widths: Of columns whose parts the header names.
        part: Name of a repeated message.
        of: Its table.

    Returns:
        Columns, columns of the parts in the order of the rows, and how many parts each row has.

    Raises:
        UnusualError: They are not written as the log's own writer does; protobuf says what is wrong, if anything is.
    """
    groups: list[tuple[NDArray[np.intp], Values, list[Values]]] = []
    lengths = np.array([len(raw) for raw in raws])
    for length in np.unique(lengths):
        left = np.flatnonzero(lengths == length)
        rows = np.frombuffer(b"".join(raws[int(i)] for i in left), dtype=np.uint8).reshape(len(left), length)
        while len(left):
            layout = layout_of(rows[0].tobytes(), message, 0, int(length))
            like = rows_like(rows, layout)
            if len(groups) == MAX_LAYOUTS or not like[0]:
                raise UnusualError
            chosen = rows[like]
            inner = [values_of(chosen, one, of, {}) for one in layout.parts.get(part, ())]
            groups.append((left[like], values_of(chosen, layout, kind, widths), inner))
            left, rows = left[~like], rows[~like]
    counts = np.zeros(len(raws), dtype=np.int64)
    for index, _, inner in groups:
        counts[index] = len(inner)
    first = np.cumsum(counts) - counts
    columns = _joined([(index, values) for index, values, _ in groups], len(raws))
    parts = [(first[index] + i, values) for index, _, inner in groups for i, values in enumerate(inner)]
    return columns, _joined(parts, int(counts.sum())), counts


def _joined(groups: Sequence[tuple[NDArray[Any], Values]], n: int) -> Values:
    """Columns of ``n`` rows from those of some rows each."""
    joined: Values = {}
    for index, values in groups:
        for name, some in values.items():
            joined.setdefault(name, np.empty((n, *some.shape[1:]), dtype=some.dtype))[index] = some
    return joined
