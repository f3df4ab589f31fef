"""Effect memories are trees of arrays; functions to copy, reset and rebuild them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from spot_model.effects.base import Memory
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray


def map_leaves(change: Callable[..., Any], tree: Any, *others: Any) -> Any:
    """The same tree (tuples, lists, dicts, dataclasses) with ``change`` of the leaves of all given trees."""
    if isinstance(tree, dict):
        return {key: map_leaves(change, value, *(o[key] for o in others)) for key, value in tree.items()}
    if isinstance(tree, (tuple, list)):
        parts = [map_leaves(change, *values) for values in zip(tree, *others, strict=True)]
        return type(tree)(*parts) if hasattr(tree, "_fields") else type(tree)(parts)
    if dataclasses.is_dataclass(tree) and not isinstance(tree, type):
        names = [f.name for f in dataclasses.fields(tree)]
        values = {n: map_leaves(change, getattr(tree, n), *(getattr(o, n) for o in others)) for n in names}
        return dataclasses.replace(tree, **values)
    return change(tree, *others)


def restarted(rows: AnyArray, fresh: Memory, old: Memory) -> Memory:
    """``fresh`` in the simulations of ``rows`` (shape (n_sims,), of the leaves' array library), ``old`` elsewhere.

    An array whose first axis has ``n_sims`` entries holds one entry a simulation; anything else is shared and stays.
    """

    def choose(new: Any, kept: Any) -> Any:
        if getattr(new, "ndim", 0) == 0 or new.shape[0] != len(rows):
            return kept
        return namespace_of(new).where(rows.reshape((-1,) + (1,) * (new.ndim - 1)), new, kept)

    return map_leaves(choose, fresh, old)


def kept_memory(old: Memory, new: Memory) -> Memory:
    """The next memory: ``new`` of NumPy; of torch ``old``, whose tensors take the new values.

    Tensors stay where they are, so that a recorded step of a GPU finds them when it is played again.
    """
    pairs: list[tuple[Any, Any]] = []
    map_leaves(lambda before, after: pairs.append((before, after)), old, new)
    moved = [(b, a) for b, a in pairs if b is not a and not isinstance(a, np.ndarray) and hasattr(a, "clone")]
    if not moved:
        return new
    # A new tensor may be a view of an old one, as in a shifted history: none is written before all are read.
    for before, after in [(b, a.clone()) for b, a in moved]:
        before.copy_(after)
    return old


def keeper(array: Any) -> Callable[[Memory, Memory], Memory]:
    """:func:`held`, or for arrays of NumPy a function that gives the new memory without a look at it."""
    return _newest if type(array) is np.ndarray else kept_memory


def _newest(_: Memory, new: Memory) -> Memory:
    return new


def tensors_of(memory: Memory) -> list[Any]:
    """The torch tensors of a memory, themselves."""
    found: list[Any] = []
    map_leaves(lambda leaf: found.append(leaf) if hasattr(leaf, "clone") else None, memory)
    return found


def own_tensors(memory: Memory) -> Memory:
    """A memory that shares no tensor with anything else; NumPy's arrays stay as they are."""
    return map_leaves(lambda leaf: leaf.clone() if hasattr(leaf, "clone") else leaf, memory)


def leaves(memory: Memory) -> list[Any]:
    """Copies of the leaves, in the tree's order."""
    found: list[Any] = []
    map_leaves(lambda leaf: found.append(np.copy(leaf) if isinstance(leaf, np.ndarray) else leaf), memory)
    return found


def with_leaves(memory: Memory, values: list[Any]) -> Memory:
    """A tree like ``memory`` with the leaves of :func:`leaves`.

    Raises:
        ValueError: There are more or fewer leaves than the tree has.
    """
    n_leaves = len(leaves(memory))
    if len(values) != n_leaves:
        raise ValueError(f"{len(values)} leaves for a memory of {n_leaves}; it was made with other effects")
    rest = iter(values)

    def replaced(_: Any) -> Any:
        value = next(rest)
        return np.copy(value) if isinstance(value, np.ndarray) else value

    return map_leaves(replaced, memory)
