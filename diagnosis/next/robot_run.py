"""One experiment on a robot, by ``spot-rl run`` in a process of its own, and the log that it leaves."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Final

from spot_log import read_run
from spot_model.errors import SpotRlError

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


def start_here(words: Sequence[str]) -> bool:
    """Start ``spot-rl`` and wait until it has ended: whoever asks to stop asks the run, which brings the robot to rest.

    A terminal sends Ctrl-C to both processes, so it is not passed on; SIGTERM is.
    """
    code = "from spot_model.io.command_line import main; main()"
    process = subprocess.Popen([sys.executable, "-c", code, *words])  # noqa: S603 - our own command line
    asked = False

    def pass_on(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        del frame
        asked = True
        if number == signal.SIGTERM:
            process.send_signal(signal.SIGTERM)

    before = {number: signal.signal(number, pass_on) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        process.wait()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    return asked
