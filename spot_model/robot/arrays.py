"""A fast look-up of an array's library, for effects at every physics step."""

from __future__ import annotations

from typing import Any

import array_api_compat
from array_api_compat import numpy as numpy_namespace
from numpy import ndarray


def namespace_of(array: Any) -> Any:
    """The array-API namespace of a NumPy array or a torch tensor, as ``array_api_compat.array_namespace`` finds it."""
    return numpy_namespace if type(array) is ndarray else array_api_compat.array_namespace(array)
