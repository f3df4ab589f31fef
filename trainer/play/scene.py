"""Robots on a floor in a browser, and a camera that goes with one of them."""

from __future__ import annotations

import contextlib
import errno
import io
import logging
import os
import socket
from collections.abc import Callable, Iterator
from typing import Final

import mujoco
import numpy as np
import viser

from spot_model.errors import BadInputError
from spot_model.robot.facts import Array
from trainer.play.shapes import Bodies, shapes_of
from trainer.play.switches import Switch

FLOOR_M: Final = 60.0
CELL_M: Final = 1.0
"""Sides of the floor and of the squares on it."""
_OTHER_PORT: Final = 8081
PACES: Final = ("1", "1/2", "1/4", "1/8")
"""Parts of real time at which robots may walk."""
CAMERA_M: Final = ((1.6, -2.4, 1.5), (0.0, 0.2, 0.2))
"""Where it stands and what it looks at, from the robot's place on the floor."""


class WebServer(viser.ViserServer):
    """Viser's server, which answers at one address alone and prints nothing."""

    def __init__(self, host: str, port: int) -> None:
        check_port(host, port)
        logging.getLogger("websockets").setLevel(logging.CRITICAL)
        with contextlib.redirect_stdout(io.StringIO()):
            super().__init__(host=host, port=port, verbose=False, label="Spot RL")
        if port not in (0, self.get_port()):
            self.stop()
            raise BadInputError(f"another program has just taken port {port}; give another one, --port {_OTHER_PORT}")

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Nothing is passed on to viser's public relay, whoever asks for it."""
        return None

    def stop(self) -> None:
        """Close all connections."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()


def check_port(host: str, port: int) -> None:
    """See that a server can listen there.

    Raises:
        BadInputError: The port is taken or not allowed, or the address is not one of this computer.
    """
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        is_port = error.errno in (errno.EADDRINUSE, errno.EACCES)
        step = (
            f"give another port, --port {_OTHER_PORT}"
            if is_port
            else "give an address of this computer, or leave out --host"
        )
        raise BadInputError(f"cannot listen at {host}:{port} ({error.strerror or error}); {step}") from error


class DrawnRobot:
    """One robot in the scene."""

    def __init__(
        self, server: viser.ViserServer, name: str, model: mujoco.MjModel, tint: tuple[int, int, int] | None = None
    ) -> None:
        self._bodies = Bodies(model)
        self._whole = server.scene.add_frame(f"/world/{name}", show_axes=False)
        places = [f"/world/{name}/{body}" for body in range(model.nbody)]
        self._frames = [server.scene.add_frame(place, show_axes=False) for place in places]
        for i, shape in enumerate(shapes_of(model)):
            server.scene.add_mesh_simple(
                f"{places[shape.body]}/{i}",
                shape.vertices_m,
                shape.faces,
                color=tint or shape.colour,
                position=shape.position_in_body_m,
                wxyz=shape.body_from_geom_wxyz,
            )
        self.put(model.key("default").qpos)

    def put(self, qpos: Array) -> None:
        """Draw it at MuJoCo's generalised position, shape (19,)."""
        for frame, position, wxyz in zip(self._frames, *self._bodies.put(qpos), strict=True):
            frame.position, frame.wxyz = position, wxyz

    def show(self, *, is_shown: bool) -> None:
        """Show or hide it."""
        self._whole.visible = is_shown


class WebScene:
    """A floor with robots; the whole world moves under the camera, so that everyone may turn it as they like."""

    def __init__(self, server: viser.ViserServer) -> None:
        self.server = server
        self.follows = True
        self._frames, self.watched_s = 0, 0.0
        self._centre_m = np.zeros(2)
        server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        server.initial_camera.position, server.initial_camera.look_at = CAMERA_M
        self._world = server.scene.add_frame("/world", show_axes=False)
        self._floor = server.scene.add_grid(
            "/floor",
            FLOOR_M,
            FLOOR_M,
            cell_size=CELL_M,
            section_size=5.0 * CELL_M,
            plane_color=(224, 228, 232),
            plane_opacity=1.0,
            cell_color=(190, 197, 204),
            section_color=(150, 160, 170),
            fade_distance=FLOOR_M / 2.0,
            position=(0.0, 0.0, -0.001),
        )

    @property
    def frame_rate_hz(self) -> float:
        """Frames a second that were drawn while a browser watched; 0 if none ever did."""
        return self._frames / self.watched_s if self.watched_s else 0.0

    def add_follow(self) -> None:
        """Put a box on the page: whether the camera goes with the robot."""
        follow = self.server.gui.add_checkbox("follow the robot", initial_value=True)
        follow.on_update(lambda _: setattr(self, "follows", follow.value))

    def add_beside(self, title: str, width_px: float) -> viser.GuiHtmlHandle:
        """What is shown in a panel beside the robots."""
        panel = self.server.gui.add_panel()
        with panel.add_tab(title):
            shown = self.server.gui.add_html("")
        panel.float(x=15.0, y=15.0, width=width_px)
        return shown

    @contextlib.contextmanager
    def frame(self, centre_m: Array) -> Iterator[None]:
        """Draw one frame: what is changed inside arrives together; ``centre_m`` is the robot's x and y."""
        if self.follows:
            self._centre_m = centre_m
        x, y = (float(v) for v in self._centre_m)
        with self.server.atomic():
            self._world.position = (-x, -y, 0.0)
            cell = 5.0 * CELL_M
            self._floor.position = (-(x % cell), -(y % cell), -0.001)
            yield
        self._frames += 1


def offer(gui: viser.GuiApi, switch: Switch, turned: Callable[[Switch, Callable[[], float | None]], None]) -> None:
    """Put a switch, and the slider of its size, on the page.

    Args:
        gui: The page.
        switch: What is offered.
        turned: Called in a thread of viser's, with what tells the size, or None for off.
    """
    on = gui.add_checkbox(switch.words, initial_value=False)
    slider = switch.slider
    size = None if slider is None else gui.add_slider(slider.words, *slider[1:])

    def size_now() -> float | None:
        return None if not on.value else 1.0 if size is None else float(size.value)

    on.on_update(lambda _: turned(switch, size_now))
    if size is not None:
        size.on_update(lambda _: turned(switch, size_now))


def address_lines(host: str, port: int) -> str:
    """Where to open the page, and how from another computer."""
    shown = "localhost" if host == "127.0.0.1" else host
    lines = [f"open http://{shown}:{port} in a browser; Ctrl-C ends"]
    if host == "127.0.0.1":
        name = os.uname().nodename
        lines.append(f"from another computer first: ssh -L {port}:localhost:{port} {name}")
    else:
        lines.append("everyone who reaches this address can watch and steer: there is no password")
    return "\n".join(lines)
