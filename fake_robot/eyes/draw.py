"""The cameras' process: ``python -m fake_robot.eyes.draw FD`` draws whatever is asked for over a socket.

It gives way to every other process, so that robot time does not wait for pictures. It ends when the socket closes.
"""

from __future__ import annotations

import os
import sys
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fake_robot.network.requests import MAX_DEPTH_M, CameraView
from fake_robot.scenario.scenario import Scenario

NICENESS = 15
_LENS_FROM_OPENGL_WXYZ = np.array([0.0, 1.0, 0.0, 0.0])
"""OpenGL looks along -z, with y up: half a turn about x."""


class Scene:
    """The scenario's world, as its cameras see it.

    Raises:
        Exception: MuJoCo cannot draw on this computer; which error it is, its OpenGL decides.
    """

    def __init__(self, scenario: Scenario) -> None:
        import mujoco

        from fake_robot.body.body_model import scene_model

        self._mujoco = mujoco
        self._model = scene_model(scenario)
        self._data = mujoco.MjData(self._model)
        self._renderers: dict[tuple[int, int], Any] = {}
        self._renderer(64, 48).render()

    def draw(self, position: NDArray[np.float64], view: CameraView) -> NDArray[Any]:
        """What a camera sees, shape (rows, cols): grey from 0 to 255, or mm of depth, 0 where nothing is near enough.

        ``position`` is the body's place (m) and attitude (wxyz) in the world, then the joints (rad); shape (19,).
        """
        model, data, mujoco = self._model, self._data, self._mujoco
        model.cam_pos[0], model.cam_fovy[0] = view.position_in_body_m, np.degrees(view.field_of_view_y_rad)
        mujoco.mju_mulQuat(model.cam_quat[0], np.array(view.body_from_lens_wxyz), _LENS_FROM_OPENGL_WXYZ)
        data.qpos[:] = position
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        renderer = self._renderer(view.cols, view.rows)
        if view.is_depth:
            renderer.enable_depth_rendering()
        renderer.update_scene(data, camera=0)
        pixels = renderer.render()
        if view.is_depth:
            renderer.disable_depth_rendering()
            return np.where(pixels <= MAX_DEPTH_M, 1000.0 * pixels, 0.0).astype(np.uint16)
        # Luma of ITU-R BT.601.
        return np.asarray(pixels @ np.array([0.299, 0.587, 0.114])).round().astype(np.uint8)

    def _renderer(self, cols: int, rows: int) -> Any:
        if (cols, rows) not in self._renderers:
            self._renderers[cols, rows] = self._mujoco.Renderer(self._model, rows, cols)
        return self._renderers[cols, rows]


def serve(connection: Connection) -> None:
    """Draw until the other end closes. The first answer is None, or why nothing can be drawn."""
    try:
        scene = Scene(connection.recv())
    except Exception as error:  # noqa: BLE001 - each OpenGL has errors of its own
        connection.send(f"{type(error).__name__}: {error}")
        return
    connection.send(None)
    while True:
        connection.send(scene.draw(*connection.recv()))


if __name__ == "__main__":
    os.nice(NICENESS)
    try:
        serve(Connection(int(sys.argv[1])))
    except (EOFError, OSError):
        sys.exit(0)
