"""What stands beside the robot: its velocity and gait in words, and a gait diagram."""

from __future__ import annotations

import mujoco
import numpy as np

from spot_model.robot import facts
from trainer.play.walk import SEEN_S, Walk

COLOURS = ((0.95, 0.75, 0.1), (0.3, 0.65, 1.0), (0.3, 0.65, 1.0), (0.95, 0.75, 0.1))
"""Of the bars of fl, fr, hl, hr: one colour a diagonal."""


def columns(walk: Walk) -> tuple[str, str]:
    """Names and values, a line each; ASCII, which is all that MuJoCo's font has."""
    units = ("m/s", "m/s", "rad/s")
    names = ["forward", "left", "turn"]
    values = [
        f"{is_:5.2f} of {asked:5.2f} {unit}"
        for is_, asked, unit in zip(walk.velocity, walk.command, units, strict=True)
    ]
    gait = walk.gait
    names += ["gait", "strides", "time", "falls"]
    values += ["-", "-"] if gait is None else [gait.name, f"{gait.stride_hz:.1f} /s"]
    values += [f"{walk.time_s:.1f} s", str(walk.falls)]
    return "\n".join(names), "\n".join(values)


def gait_diagram(walk: Walk) -> mujoco.MjvFigure:
    """A bar for each time that a foot is on the ground, over the last two seconds; fl on top, then fr, hl, hr."""
    figure = mujoco.MjvFigure()
    mujoco.mjv_defaultFigure(figure)
    figure.title = "on the ground: fl, fr, hl, hr"
    figure.range[:] = ((-SEEN_S, 0.0), (0.5, facts.N_LEGS + 0.5))
    figure.gridsize[:] = (5, 2)
    figure.flg_ticklabel[:] = (1, 0)
    figure.xformat = "%.1f s"
    figure.linewidth = 9.0
    figure.figurergba[:] = (0.0, 0.0, 0.0, 0.5)
    contact, line = walk.contact, 0
    for leg, colour in enumerate(COLOURS):
        edges = np.flatnonzero(np.diff(np.r_[False, contact[:, leg], False].astype(np.int8)))
        for start, end in edges.reshape(-1, 2)[-len(figure.linepnt) // facts.N_LEGS :]:
            times = (np.array([start, end]) - len(contact)) * walk.plant.timestep_s
            height = facts.N_LEGS - leg
            figure.linepnt[line], figure.linergb[line] = 2, colour
            figure.linedata[line, :4] = (times[0], height, times[1], height)
            line += 1
    return figure
