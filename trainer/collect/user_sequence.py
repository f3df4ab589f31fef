"""``spot-rl user-sequence``: the velocity commands of a log, to be played again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import numpy as np
import typer
from numpy.typing import NDArray

from spot_log import Run, read_run
from spot_log.format.events import FOLLOWING_MODE
from spot_model.errors import BadInputError
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint, save_sequence

TOLERANCE: Final = 0.01
"""How far (m/s, rad/s) the played commands may lie from the recorded ones."""


def user_sequence(
    log: Annotated[Path, typer.Argument(help="Log of a run under keyboard or gamepad.")],
    out: Annotated[Path, typer.Option(help="YAML file to write.")],
    name: Annotated[str, typer.Option(help="Name of the sequence.")] = "user",
) -> None:
    """Convert the velocity commands of a steered run to a sequence for collect and run."""
    sequence = sequence_of_run(read_run(log), name)
    save_sequence(sequence, out)
    typer.echo(f"{out}: {len(sequence.waypoints)} waypoints over {sequence.duration_s:g} s")


def sequence_of_run(run: Run, name: str) -> VelocitySequence:
    """The commands of a run's active ticks. Raises BadInputError: the log has fewer than two of them."""
    rows = run.ticks.mode == FOLLOWING_MODE
    if rows.sum() < 2:
        raise BadInputError(
            f"{run.path} has no ticks under the policy's control; record a run with --keyboard or --gamepad"
        )
    stamps = run.ticks.robot_stamp_ns[rows]
    return sequence_of_commands((stamps - stamps[0]) * 1e-9, run.ticks.velocity_command[rows], name)


def sequence_of_commands(time_s: NDArray[np.float64], command: NDArray[np.float64], name: str) -> VelocitySequence:
    """Few straight pieces through sampled commands, each within :data:`TOLERANCE` of all samples.

    Args:
        time_s: Shape (n,), rising from 0.
        command: V_x, V_y (m/s), ω_z (rad/s). Shape (n, 3).
        name: Name of the sequence.
    """
    kept = [0]
    while kept[-1] < len(time_s) - 1:
        kept.append(_reach(time_s, command, kept[-1]))
    points = [
        Waypoint(
            time_s=round(float(time_s[i]), 4),
            v_x_m_s=round(float(command[i, 0]), 4),
            v_y_m_s=round(float(command[i, 1]), 4),
            yaw_rate_rad_s=round(float(command[i, 2]), 4),
            ramp=number > 0,
        )
        for number, i in enumerate(kept)
    ]
    return VelocitySequence(name=name, duration_s=points[-1].time_s, waypoints=tuple(points))


def _reach(time_s: NDArray[np.float64], command: NDArray[np.float64], start: int) -> int:
    """The last sample to which a straight line from ``start`` stays close to all samples between."""
    end = start + 1
    for candidate in range(start + 1, len(time_s)):
        share = (time_s[start : candidate + 1] - time_s[start]) / (time_s[candidate] - time_s[start])
        line = command[start] + share[:, None] * (command[candidate] - command[start])
        if np.abs(line - command[start : candidate + 1]).max() > TOLERANCE:
            break
        end = candidate
    return end
