"""The columns of a table from many protobuf messages: from objects, or straight from their wire bytes.

Most messages of a topic have their values at the same places in their bytes. Such a layout is read off one message, and
holds for another of the same length whose tags, lengths, texts and ends of numbers are the same; then its values are
there, too, and no object a message is made. Whatever has an unusual layout is left to protobuf.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from typing import Any, Final, TypeVar

import numpy as np
from google.protobuf.descriptor import FieldDescriptor
from numpy.typing import NDArray

from spot_log.errors import LogReadError
from spot_log.format.tables import Column, Ints, Table, width_of

TableT = TypeVar("TableT", bound=Table)
ItemT = TypeVar("ItemT")
ResultT = TypeVar("ResultT")
Bytes = NDArray[np.uint8]


def on_all_cores(function: Callable[[ItemT], ResultT], items: Iterable[ItemT]) -> list[ResultT]:
    """The results of a function that gives Python's lock back most of the time, in the order of the items."""
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        return list(pool.map(function, items))


def numbers_at(buffer: Bytes, places: Ints, dtype: str) -> NDArray[Any]:
    """Numbers that begin anywhere in a buffer."""
    size = np.dtype(dtype).itemsize
    return np.ndarray(max(len(buffer) - size + 1, 0), dtype, buffer, strides=(1,))[places]


@dataclass(frozen=True)
class Parsed:
    """Messages as protobuf's objects, whose fields are named as a table's columns."""

    messages: Sequence[Any]

    def widest(self, name: str) -> int:
        """Length of the longest array of that name; 0 where there is none."""
        return max((len(getattr(message, name)) for message in self.messages), default=0)

    def part(self, name: str) -> tuple[Parsed, Ints]:
        """The messages in a repeated field, and how many each message has."""
        counts = [len(getattr(message, name)) for message in self.messages]
        return Parsed([one for message in self.messages for one in getattr(message, name)]), np.array(counts, np.int64)

    def table(self, kind: type[TableT], widths: Mapping[str, int], **given: Any) -> TableT:
        """A table of the messages, with columns that are given. Raises LogReadError."""
        columns = {n: self._column(n, c, widths) for n, c in kind.columns().items() if n not in given}
        return kind(**columns, **given)

    def _column(self, name: str, declared: Column, widths: Mapping[str, int]) -> NDArray[Any]:
        """One column; an empty array becomes a row of NaN; booleans of which no message has any have no columns."""
        width, dtype = width_of(declared, widths), declared.dtype
        rows = [getattr(message, name) for message in self.messages]
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


_INT, _DOUBLE, _BYTES = 0, 1, 2
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


class UnusualError(Exception):
    """A message is not written as the log's own writer does."""


@dataclass
class Layout:
    """Where a message's values stand in its bytes."""

    spans: dict[str, tuple[int, int]] = field(default_factory=dict)
    """Begin and end of each field's value."""
    texts: dict[str, str] = field(default_factory=dict)
    parts: dict[str, list[Layout]] = field(default_factory=dict)
    """Messages within; their places, too, are counted from the begin of the outermost."""


def layout_of(data: bytes, kind: Any, at: int, end: int, mask: bytearray) -> Layout:
    """The layout of the message in ``data[at:end]``, whose descriptor is ``kind``.

    ``mask``, as long as ``data``, becomes 1 where a bit has to be the same in a message of the same layout.

    Raises:
        UnusualError: A field is unknown, of a kind that is not for tables, or comes twice.
    """
    layout = Layout()
    while at < end:
        begin = at
        tag, at = _int(data, at, end)
        declared = kind.fields_by_number.get(tag >> 3)
        if declared is None or declared.name in layout.spans:
            raise UnusualError
        name, wire, stop = declared.name, tag & 7, at
        if wire == _INT and declared.type in _INT_BYTES and not declared.is_repeated:
            _, stop = _int(data, at, end)
            mask[at:stop] = b"\x80" * (stop - at)
            if stop - at > _INT_BYTES[declared.type]:
                raise UnusualError
        elif wire == _DOUBLE and declared.type == FieldDescriptor.TYPE_DOUBLE and not declared.is_repeated:
            stop = at + 8
        elif wire == _BYTES and (declared.is_repeated or declared.type == FieldDescriptor.TYPE_STRING):
            length, at = _int(data, at, end)
            stop = at + length
        else:
            raise UnusualError
        mask[begin:at] = b"\xff" * (at - begin)
        if stop > end:
            raise UnusualError
        if declared.message_type is not None:
            layout.parts.setdefault(name, []).append(layout_of(data, declared.message_type, at, stop, mask))
        elif declared.type == FieldDescriptor.TYPE_STRING and not declared.is_repeated:
            try:
                layout.texts[name] = data[at:stop].decode()
            except UnicodeDecodeError as error:
                raise UnusualError from error
            layout.spans[name] = at, stop
            mask[at:stop] = b"\xff" * (stop - at)
        elif wire != _BYTES or (declared.type in _ARRAYS and (stop - at) % _ARRAYS[declared.type].itemsize == 0):
            layout.spans[name] = at, stop
            if declared.type == FieldDescriptor.TYPE_BOOL:
                mask[at:stop] = b"\xfe" * (stop - at)
                if max(data[at:stop], default=0) > 1:  # a flag may have more than one byte
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


def _rows_like(buffer: Bytes, first: bytes, mask: bytearray, starts: Ints) -> NDArray[np.bool_]:
    """Which of the messages that begin at ``starts`` are, where the mask has ones, like the first."""
    padded, at = (first + bytes(8), bytes(mask) + bytes(8)), 0
    differing = np.zeros(len(starts), dtype=np.uint64)
    while rest := bytes(mask[at:]).lstrip(b"\0"):
        at = len(mask) - len(rest)
        model, wanted = (np.frombuffer(some, "<u8", 1, at) for some in padded)
        differing |= (numbers_at(buffer, starts + at, "<u8") ^ model) & wanted
        at += 8
    return np.asarray(differing == 0)


@dataclass(frozen=True)
class Wire:
    """Messages as they stand in a buffer, which goes on for 16 bytes behind the last one."""

    buffer: Bytes
    starts: Ints
    kind: Any
    """Their descriptor."""
    layouts: Sequence[Layout]
    which: Ints
    """Number of the layout of each message."""

    @classmethod
    def of(cls, buffer: Bytes, starts: Ints, lengths: Ints, kind: Any) -> Wire:
        """Find the layouts.

        Raises:
            UnusualError: They are not written as the log's own writer does, or there are none; protobuf says what is
                wrong, if anything is.
        """
        layouts: list[Layout] = []
        which = np.zeros(len(starts), dtype=np.int64)
        if not len(starts):
            raise UnusualError
        for length in np.unique(lengths).tolist():
            left = np.flatnonzero(lengths == length)
            while len(left):
                first, mask = buffer[starts[left[0]] :][:length].tobytes(), bytearray(length)
                layout = layout_of(first, kind, 0, length, mask)
                # So few at a time that what is looked at stays in the cache.
                blocks = np.array_split(starts[left], len(left) // 4096 + 1)
                like = np.concatenate(on_all_cores(partial(_rows_like, buffer, first, mask), blocks))
                if len(layouts) == MAX_LAYOUTS or not like[0]:
                    raise UnusualError
                which[left[like]] = len(layouts)
                layouts.append(layout)
                left = left[~like]
        return cls(buffer, starts, kind, layouts, which)

    def widest(self, name: str) -> int:
        """Length of the longest array of that name; 0 where there is none."""
        spans = [layout.spans.get(name, (0, 0)) for layout in self.layouts]
        return max(end - begin for begin, end in spans) // _ARRAYS[self.kind.fields_by_name[name].type].itemsize

    def part(self, name: str) -> tuple[Wire, Ints]:
        """The messages in a repeated field, in the order of the rows, and how many each message has."""
        parts = [layout.parts.get(name, []) for layout in self.layouts]
        of_layout = np.array([len(some) for some in parts], dtype=np.int64)
        counts = of_layout[self.which]
        nth = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        which = np.repeat((np.cumsum(of_layout) - of_layout)[self.which], counts) + nth
        kind = self.kind.fields_by_name[name].message_type
        return Wire(self.buffer, np.repeat(self.starts, counts), kind, list(chain(*parts)), which), counts

    def table(self, kind: type[TableT], widths: Mapping[str, int], **given: Any) -> TableT:
        """A table of the messages, with columns that are given. Raises UnusualError."""
        names = [name for name in kind.columns() if name not in given]
        found = on_all_cores(partial(self._column, kind.columns(), widths), names if len(self.starts) else [])
        return kind(**dict(zip(names, found, strict=True)), **given) if len(self.starts) else kind.of(0, widths)

    def _column(self, columns: Mapping[str, Column], widths: Mapping[str, int], name: str) -> NDArray[Any]:
        declared, kind = columns[name], self.kind.fields_by_name[name].type
        if kind == FieldDescriptor.TYPE_STRING:
            return np.array([layout.texts.get(name, "") for layout in self.layouts])[self.which]
        spans = np.array([layout.spans.get(name, (0, 0)) for layout in self.layouts])
        begins, sizes = self.starts + spans[:, 0].take(self.which), spans[:, 1] - spans[:, 0]
        if kind in _INT_BYTES:
            return self._ints(begins, sizes).astype(declared.dtype, copy=False)
        width, dtype = width_of(declared, widths), _ARRAYS[kind]
        size = (1 if width is None else width) * dtype.itemsize
        missing = np.flatnonzero(sizes == 0)
        if ((sizes != size) & (sizes != 0)).any() or (dtype.kind == "u" and len(missing)):
            raise UnusualError
        if not len(missing):
            values = numbers_at(self.buffer, begins, f"V{size}").view(dtype).reshape(len(begins), -1)
        else:
            nothing = 0 if width is None else declared.missing
            values = np.full((len(begins), size // dtype.itemsize), nothing, dtype)
            here = np.flatnonzero(~np.isin(self.which, missing))
            if len(here):
                values[here] = numbers_at(self.buffer, begins[here], f"V{size}").view(dtype).reshape(len(here), -1)
        return (values[:, 0] if width is None else values).astype(declared.dtype, copy=False)

    def _ints(self, begins: Ints, sizes: Ints) -> Ints:
        """Numbers of base 128, by their size in each layout: groups of seven bits move together, two, four, eight."""
        u8 = np.uint64
        words = np.array([(1 << 8 * min(size, 8)) - 1 for size in sizes.tolist()], dtype=u8)
        low = numbers_at(self.buffer, begins, "<u8") & words.take(self.which)
        low = (low & u8(0x007F007F007F007F)) | (low & u8(0x7F007F007F007F00)) >> u8(1)
        low = (low & u8(0x00003FFF00003FFF)) | (low & u8(0x3FFF00003FFF0000)) >> u8(2)
        low = (low & u8(0x000000000FFFFFFF)) | (low & u8(0x0FFFFFFF00000000)) >> u8(4)
        for nth in range(8, sizes.max()):
            bits = np.where(sizes > nth, u8(0x7F), u8(0)).take(self.which)
            low |= (self.buffer[begins + nth] & bits) << u8(7 * nth)
        return low.view(np.int64)
