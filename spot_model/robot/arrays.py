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
