"""LocalGridService: maps of the level ground around the robot, on which nothing else stands."""

from __future__ import annotations

import math
import struct
from typing import Final

from bosdyn.api import local_grid_pb2
from bosdyn.client.frame_helpers import BODY_FRAME_NAME, GROUND_PLANE_FRAME_NAME, ODOM_FRAME_NAME, get_a_tform_b
from bosdyn.client.math_helpers import Quat, SE3Pose

from fake_robot.services.calls.stamps import timestamp_from_ns
from fake_robot.services.calls.unary import Call
from fake_robot.services.reports.robot_state_message import frame_tree

CELLS: Final = 128
"""Cells of a side, and the size of one: as in the maps that the vendor's SDK brings as an example."""
CELL_M: Final = 0.03

Grid = local_grid_pb2.LocalGrid
_FORMATS: Final = {
    "terrain": (Grid.CELL_FORMAT_FLOAT32, b""),
    "terrain_valid": (Grid.CELL_FORMAT_UINT8, b"\1"),
    "no_step": (Grid.CELL_FORMAT_UINT8, b"\0"),
    "obstacle_distance": (Grid.CELL_FORMAT_FLOAT32, struct.pack("<f", 0.5 * CELLS * CELL_M)),
}
"""Format and value of every cell: terrain is the ground's height in odom; no obstacle is nearer than the map's edge."""


def list_types(call: Call) -> None:
    """Answer a ``GetLocalGridTypesRequest``."""
    for name in _FORMATS:
        call.response.local_grid_type.add(name=name)


def get_grids(call: Call) -> None:
    """Answer a ``GetLocalGridsRequest``: the asked maps, centred below the body and aligned with odom."""
    snapshot = call.world.robot.snapshot()
    frames = frame_tree(snapshot)
    body = get_a_tform_b(frames, ODOM_FRAME_NAME, BODY_FRAME_NAME)
    ground_m = get_a_tform_b(frames, ODOM_FRAME_NAME, GROUND_PLANE_FRAME_NAME).z
    x_m, y_m = (CELL_M * (math.floor(at / CELL_M) - CELLS // 2) for at in (body.x, body.y))
    for wanted in call.request.local_grid_requests:
        name = wanted.local_grid_type_name
        entry = call.response.local_grid_responses.add(local_grid_type_name=name)
        if name not in _FORMATS:
            entry.status = entry.STATUS_NO_SUCH_GRID
            call.response.num_local_grid_errors += 1
            continue
        entry.status, grid = entry.STATUS_OK, entry.local_grid
        grid.local_grid_type_name, grid.frame_name_local_grid_data = name, f"{name}_local_grid_corner"
        grid.acquisition_time.CopyFrom(timestamp_from_ns(snapshot.robot_stamp_ns))
        grid.transforms_snapshot.CopyFrom(frames)
        corner = grid.transforms_snapshot.child_to_parent_edge_map[grid.frame_name_local_grid_data]
        corner.parent_frame_name = ODOM_FRAME_NAME
        corner.parent_tform_child.CopyFrom(SE3Pose(x_m, y_m, 0.0, Quat()).to_proto())
        grid.extent.cell_size, grid.extent.num_cells_x, grid.extent.num_cells_y = CELL_M, CELLS, CELLS
        grid.cell_format, cell = _FORMATS[name]
        grid.encoding, grid.data = Grid.ENCODING_RAW, (cell or struct.pack("<f", ground_m)) * CELLS**2
        grid.cell_value_scale = 1.0
