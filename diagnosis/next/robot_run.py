"""One experiment on a robot, by ``spot-rl run`` in a process of its own, and the log that it leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from spot_log import read_run
from spot_model.errors import SpotRlError
from spot_model.io.child_process import module_command
from spot_model.io.signals import run_in_foreground

WHOLE: Final = "completed"
"""Outcome of a run that went to its end."""


@dataclass(frozen=True)
class Ran:
    """What came of a run."""

    log: Path | None
    robot_s: float
    """From the log's first state to its last."""
    outcome: str
    """:data:`WHOLE`, or why it ended early."""
    is_interrupted: bool = False


def run_on_robot(words: Sequence[str], log_dir: Path) -> Ran:
    """Run an experiment until the robot rests; ``words`` are the arguments of ``spot-rl``."""
    before = set(log_dir.glob("*.mcap"))
    is_interrupted = run_in_foreground(module_command("spot_model", *words)).is_interrupted
    made = sorted(set(log_dir.glob("*.mcap")) - before)
    if not made:
        return Ran(None, 0.0, "it left no log", is_interrupted)
    try:
        run = read_run(made[-1])
    except SpotRlError as error:
        return Ran(None, 0.0, str(error), is_interrupted)
    return Ran(made[-1], run.duration_s, run.outcome, is_interrupted)


def is_here(robot: str) -> bool:
    """Whether an address is of this computer, where no real robot is.

    Raises:
        BadInputError: It is no address.
    """
    # Here: a ranking needs no connection, and no gRPC.
    from spot_runtime.hal.connection.address import parse_address
    from spot_runtime.operator.listening import is_loopback, is_unix

    address = parse_address(robot)
    return is_loopback(address.host if is_unix(address.host) else f"{address.host}:{address.port}")
