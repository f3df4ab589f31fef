"""Products of many small vectors."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from diagnosis.channels.channel_view import Array

Vectors = NDArray[np.floating[Any]]


def cross(a: Vectors, b: Vectors) -> Array:
    """Cross product along the last axis, of size 3; the bits of NumPy's own, which takes twice as long."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for component, (first, second) in enumerate((((ay, bz), (az, by)), ((az, bx), (ax, bz)), ((ax, by), (ay, bx)))):
        np.subtract(first[0] * first[1], second[0] * second[1], out=out[..., component])
    return out
