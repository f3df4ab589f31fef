"""A made-up track, every number of it known."""

from __future__ import annotations

import numpy as np

from compare.tracks import STEP_S, Track


def a_track(
    name: str = "log",
    n: int = 400,
    *,
    late_s: float = 0.0,
    speed_m_s: float = 1.0,
    heading_rad: float = 0.0,
    offset_rad: float = 0.0,
) -> Track:
    """A robot that walks straight ahead in a heading, its joints on a sine."""
    time_s = np.arange(n) * STEP_S - late_s
    command = np.zeros((n, 3))
    command[:, 0] = np.where(time_s > 1.0, 1.0, 0.0)
    position = np.tile(0.1 * np.sin(2.0 * np.pi * time_s)[:, None], (1, 12)) + offset_rad
    ahead = speed_m_s * np.maximum(time_s, 0.0)
    body = np.column_stack([ahead * np.cos(heading_rad), ahead * np.sin(heading_rad), np.full(n, 0.5)])
    attitude = np.tile([np.cos(heading_rad / 2), 0.0, 0.0, np.sin(heading_rad / 2)], (n, 1))
    stamps = 5_000_000_000 + np.arange(n, dtype=np.int64) * round(STEP_S * 1e9)
    return Track(
        name=name,
        is_simulated=False,
        whole_s=n * STEP_S,
        fell=False,
        start_ns=int(stamps[0]),
        stamp_ns=stamps,
        velocity_command=command,
        set_point_rad=position.copy(),
        position_rad=position,
        velocity_rad_s=np.gradient(position, STEP_S, axis=0),
        load_nm=10.0 * position,
        body_velocity=np.tile([speed_m_s, 0.0, 0.0], (n, 1)),
        position_of_body_in_odom_m=body,
        odom_from_body_wxyz=attitude,
        foot_contact=np.zeros((n, 4), dtype=np.bool_),
    )
