"""Gather the fields of many protobuf messages into the columns of a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from spot_log.errors import LogReadError
from spot_log.format.table import Column, Table, width_of

Messages = Sequence[Any]
TableT = TypeVar("TableT", bound=Table)
_TEXT: Final = "log record {name}: row {row} has {found} values, expected {width}"


def gather(kind: type[TableT], messages: Messages, widths: Mapping[str, int], **given: Any) -> TableT:
    """A table of messages whose fields are named as its columns.

    Raises:
        LogReadError: A message holds an array of another length.
    """
    columns = {n: _gathered(messages, n, c, widths) for n, c in kind.columns().items() if n not in given}
    return kind(**columns, **given)


def _gathered(messages: Messages, name: str, declared: Column, widths: Mapping[str, int]) -> NDArray[Any]:
    width = width_of(declared, widths)
    if width is None:
        return np.array([getattr(message, name) for message in messages], dtype=declared.dtype)
    if declared.dtype.kind == "b":
        return flags(messages, name, width)
    return matrix(messages, name, width, declared.dtype)


def matrix(messages: Messages, name: str, width: int, dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """One array a message; an empty one becomes a row of NaN.

    Returns:
        Shape (n, width).

    Raises:
        LogReadError: An array is neither empty nor ``width`` long.
    """
    rows = [getattr(message, name) for message in messages]
    if all(len(row) == width for row in rows):
        flat = list(chain.from_iterable(rows))
        return np.array(flat, dtype=dtype).reshape(len(messages), width)
    return _ragged(rows, name, width, dtype)


def _ragged(rows: Messages, name: str, width: int, dtype: DTypeLike) -> NDArray[Any]:
    result = np.full((len(rows), width), np.nan, dtype=dtype)
    for row, values in enumerate(rows):
        if len(values) == width:
            result[row] = values
        elif len(values):
            raise LogReadError(_TEXT.format(name=name, row=row, found=len(values), width=width))
    return result


def flags(messages: Messages, name: str, width: int) -> NDArray[np.bool_]:
    """One array of booleans a message. Returns shape (n, width), or (n, 0) where every message's is empty.

    Raises:
        LogReadError: Some messages have another number of them.
    """
    rows = [list(getattr(message, name)) for message in messages]
    if not any(rows):
        return np.zeros((len(rows), 0), dtype=np.bool_)
    for row, values in enumerate(rows):
        if len(values) != width:
            raise LogReadError(_TEXT.format(name=name, row=row, found=len(values), width=width))
    return np.array(rows, dtype=np.bool_)


def widest(messages: Messages, name: str) -> int:
    """Length of the longest array of that name; 0 where there is none."""
    return max((len(getattr(message, name)) for message in messages), default=0)
