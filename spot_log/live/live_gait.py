"""The gait of the last moments, from the states that the live view gets."""

from __future__ import annotations

from collections import deque
from typing import Any, Final

import numpy as np

from spot_model.robot import facts
from spot_model.robot.gait import measure_gait
from spot_protos import log_pb2

SEEN_S: Final = 2.0
LEAST_S: Final = 1.0
EVERY_S: Final = 0.5
JSON_SCHEMA: Final = {
    "type": "object",
    "properties": {
        "gait": {"type": "string"},
        **{name: {"type": "number"} for name in ("strides_per_s", "flight", "diagonals_agree", "others_agree")},
    },
}


class LiveGait:
    """Keeps the contacts of the last moments."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, tuple[bool, ...]]] = deque()
        self._told_s = 0.0

    def take(self, data: bytes, stamp_s: float) -> dict[str, Any] | None:
        """Count one serialised state in; now and then the gait, by :data:`JSON_SCHEMA`, else None."""
        contact = tuple(log_pb2.State.FromString(data).foot_contact)
        if self._rows and stamp_s <= self._rows[-1][0]:
            self._rows.clear()  # another run
        if len(contact) != facts.N_LEGS:
            return None
        self._rows.append((stamp_s, contact))
        while stamp_s - self._rows[0][0] > SEEN_S:
            self._rows.popleft()
        if stamp_s - self._rows[0][0] < LEAST_S or abs(stamp_s - self._told_s) < EVERY_S:
            return None
        self._told_s = stamp_s
        times, feet = zip(*self._rows, strict=True)
        gait = measure_gait(np.array(times), np.array(feet))
        return {
            "gait": gait.name,
            "strides_per_s": round(gait.stride_hz, 2),
            "flight": round(gait.flight_share, 2),
            "diagonals_agree": round(gait.diagonals_agree, 2),
            "others_agree": round(gait.others_agree, 2),
        }
