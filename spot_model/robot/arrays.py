"""A fast look-up of an array's library, for effects at every physics step."""

from __future__ import annotations

from typing import Any

import array_api_compat
import numpy as np
from numpy import ndarray


def namespace_of(array: Any) -> Any:
    """The array-API namespace of a NumPy array or a torch tensor.

    NumPy's own is one since its second version; ``array_api_compat``'s copy of it would load all of NumPy's rarely used
    parts, a fifth of the runtime's imports.
    """
    return np if type(array) is ndarray else array_api_compat.array_namespace(array)


def copy_of(array: Any) -> Any:
    """A copy of a NumPy array or a torch tensor."""
    return array.copy() if type(array) is ndarray else array.clone()


def on_host(array: Any) -> ndarray[Any, Any]:
    """The array in NumPy; of a tensor on a GPU, a copy for which the host waits."""
    return array if type(array) is ndarray else np.asarray(array.detach().cpu())


def like(array: Any, values: Any) -> Any:
    """Values as an array of ``array``'s library, dtype and device."""
    return namespace_of(array).asarray(values, dtype=array.dtype, device=array_api_compat.device(array))
