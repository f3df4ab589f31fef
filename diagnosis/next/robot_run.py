"""One experiment on a robot, by ``spot-rl run`` in a process of its own, and the log that it leaves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from spot_log import read_run
from spot_model.errors import SpotRlError
from spot_model.io.child_process import module_command
from spot_model.io.signals import run_in_foreground

Start = Callable[[Sequence[str]], bool]
"""Runs ``spot-rl`` with arguments until it has ended; says whether a person asked to stop meanwhile."""

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


def run_on_robot(words: Sequence[str], log_dir: Path, start: Start) -> Ran:
    """Run an experiment; ``words`` are the arguments of ``spot-rl``."""
    before = set(log_dir.glob("*.mcap"))
    is_interrupted = start(words)
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


def start_here(words: Sequence[str]) -> bool:
    """Start ``spot-rl``, wait until it has ended, and say whether somebody asked for that: the robot rests."""
    return run_in_foreground(module_command("spot_model", *words)).is_interrupted
