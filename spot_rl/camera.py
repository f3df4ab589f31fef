"""Pictures of simulated robots, drawn without a display."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from spot_model.robot.facts import Array
from spot_model.robot.mjcf import MjcfOptions, spot_mjcf
from spot_model.robot.terrain import Terrain
from trainer.play.film import renderer

WIDTH: Final = 480
HEIGHT: Final = 320


class Camera:
    """Draws one robot, seen from the side.

    Raises:
        BadInputError: MuJoCo finds no OpenGL that works without a display.
    """

    def __init__(self, terrain: Terrain) -> None:
        self._model = model = mujoco.MjModel.from_xml_string(spot_mjcf(MjcfOptions(terrain=terrain)))
        model.vis.global_.offwidth, model.vis.global_.offheight = WIDTH, HEIGHT
        self._data = mujoco.MjData(model)
        self._stack = ExitStack()
        self._gl, self._context = renderer(model, self._stack, "render_mode 'rgb_array'")
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._scene = mujoco.MjvScene(model, 1000)
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._scene.flags[flag] = 0
        self._view, self._option, self._perturb = mujoco.MjvCamera(), mujoco.MjvOption(), mujoco.MjvPerturb()
        self._view.distance, self._view.azimuth, self._view.elevation = 2.6, 120.0, -14.0

    def picture(self, qpos: Array) -> NDArray[np.uint8]:
        """Draw a robot whose generalised position has shape (19,); returns shape (320, 480, 3)."""
        self._gl.make_current()
        self._data.qpos[:] = qpos
        mujoco.mj_forward(self._model, self._data)
        self._view.lookat[:] = qpos[:3]
        category, whole = mujoco.mjtCatBit.mjCAT_ALL.value, mujoco.MjrRect(0, 0, WIDTH, HEIGHT)
        mujoco.mjv_updateScene(self._model, self._data, self._option, self._perturb, self._view, category, self._scene)
        mujoco.mjr_render(whole, self._scene, self._context)
        image = np.empty((HEIGHT, WIDTH, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(image, None, whole, self._context)
        return np.ascontiguousarray(image[::-1])

    def close(self) -> None:
        """Free what was taken."""
        self._stack.close()
