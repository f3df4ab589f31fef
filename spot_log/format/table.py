"""A table declares its columns once: name, type and width; reading, packing, cutting and exporting follow from it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray
from typing_extensions import Self

AXES: Final = ("x", "y", "z")
WXYZ: Final = ("w", "x", "y", "z")
VELOCITY: Final = ("x_m_s", "y_m_s", "yaw_rad_s")

Parts = tuple[str, ...] | str | None
"""Names of a row's values; ``"joints"`` or ``"feet"``, named in the header; ``"#"``, numbered; None for one value."""


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    dtype: np.dtype[Any]
    parts: Parts

    @property
    def missing(self) -> Any:
        """What stands where the source has nothing: NaN, 0, False or an empty text."""
        return np.nan if self.dtype.kind == "f" else self.dtype.type()


def column(dtype: DTypeLike, parts: Parts = None) -> Any:
    """Declare a dataclass field as a column, shape (n,), or (n, number of ``parts``)."""
    return dataclasses.field(metadata={"column": Column(np.dtype(dtype), parts)})


@dataclass(frozen=True)
class Table:
    """Columns of equal length, one row a message."""

    @classmethod
    @cache
    def columns(cls) -> Mapping[str, Column]:
        """The declared columns by name, in order."""
        return MappingProxyType(
            {f.name: f.metadata["column"] for f in dataclasses.fields(cls) if "column" in f.metadata}
        )

    @classmethod
    def of(cls, n: int, widths: Mapping[str, int], **given: Any) -> Self:
        """A table of ``n`` rows from some of its columns; the others hold what stands for a missing value.

        Args:
            n: Number of rows.
            widths: Of the columns whose parts the header names: ``joints``, ``feet``.
            given: Columns, and what the table holds beside its columns.
        """
        for name, declared in cls.columns().items():
            if name not in given:
                width = width_of(declared, widths)
                shape = (n,) if width is None else (n, width)
                given[name] = np.full(shape, declared.missing, dtype=declared.dtype)
        return cls(**given)

    def rows(self, index: NDArray[Any] | slice) -> Self:
        """The rows of ``index``: numbers, a mask or a slice."""
        chosen = np.arange(len(self))[index]

        def cut(value: Any) -> Any:
            return value[chosen] if isinstance(value, np.ndarray) else tuple(value[i] for i in chosen)

        return dataclasses.replace(self, **{f.name: cut(getattr(self, f.name)) for f in dataclasses.fields(self)})

    def flat(self, names: Mapping[str, tuple[str, ...]]) -> dict[str, NDArray[Any]]:
        """One named column a scalar: ``name`` or ``name.part``; a signal of another width than its parts is left out.

        Args:
            names: Of ``joints`` and ``feet``.
        """
        single, spread = {}, {}
        for name, declared in self.columns().items():
            values = getattr(self, name)
            if declared.parts is None:
                single[name] = values
                continue
            parts = _part_names(declared.parts, names, values.shape[1])
            if len(parts) == values.shape[1]:
                spread.update({f"{name}.{part}": values[:, i] for i, part in enumerate(parts)})
        return {**single, **spread}

    def __len__(self) -> int:
        return len(getattr(self, next(iter(self.columns()))))


def width_of(declared: Column, widths: Mapping[str, int]) -> int | None:
    """Values a row; None for one alone."""
    if declared.parts is None:
        return None
    return widths[declared.parts] if isinstance(declared.parts, str) else len(declared.parts)


def _part_names(parts: tuple[str, ...] | str, names: Mapping[str, tuple[str, ...]], width: int) -> tuple[str, ...]:
    if isinstance(parts, tuple):
        return parts
    return tuple(f"{i:02d}" for i in range(width)) if parts == "#" else names[parts]
