"""What a camera looks at: where its lens sits, how many pixels it has, and whether they are grey or depth."""

from __future__ import annotations

import math
from dataclasses import dataclass

MAX_DEPTH_M = 4.0
"""Depth cameras see no further. Source: the vendor's data sheet."""


@dataclass(frozen=True)
class CameraView:
    """One camera with a pinhole lens that sees 90 degrees across."""

    position_in_body_m: tuple[float, float, float]
    body_from_lens_wxyz: tuple[float, float, float, float]
    """The lens' z looks ahead, its x to the right and its y down."""
    cols: int
    rows: int
    is_depth: bool

    @property
    def field_of_view_y_rad(self) -> float:
        """Angle between the image's upper and lower edge."""
        return 2.0 * math.atan(self.rows / self.cols)
