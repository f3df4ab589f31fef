"""The steps of an improvement: each is a spot-rl command that leaves a file, and is not run again where that is."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from spot_model.errors import GpuMemoryError, SpotRlError
from spot_model.process.child_process import module_command
from spot_model.process.signals import run_in_foreground

Say = Callable[[str], None]
INTERRUPTED: Final = 130


class StepError(SpotRlError):
    """A step's command failed; what went wrong stands above, in its own words."""


@dataclass(frozen=True)
class CommandStep:
    """One command of the improvement.

    Args:
        about: What it does, for the progress line.
        words: The command, without ``spot-rl``.
        result: The file whose presence says that it is done.
        on_cores: What to run where the GPU's memory does not suffice; none: the error stands.
    """

    about: str
    words: tuple[str, ...]
    result: Path
    on_cores: tuple[str, ...] = ()

    @property
    def command(self) -> str:
        """The command, as a person would type it."""
        return " ".join(["spot-rl", *self.words])


def take(step: CommandStep, say: Say) -> float | None:
    """Run a step unless its result is there; returns its seconds, None if it was done before.

    Raises:
        StepError: The command failed, or left no result.
        GpuMemoryError: The GPU has too little memory, and the step cannot be taken on the cores.
        KeyboardInterrupt: The user stopped it.
    """
    if step.result.exists():
        say(f"{step.about}: done before ({step.result})")
        return None
    say(f"{step.about}: {step.command}")
    began_s = time.monotonic()
    code = run_command(step.words)
    if code == GpuMemoryError.exit_code and step.on_cores:
        say(f"{step.about}: the GPU has too little memory; on the cores instead")
        code = run_command(step.on_cores)
    if code == GpuMemoryError.exit_code:
        raise GpuMemoryError(f"{step.command}: the GPU has too little memory")
    if code == INTERRUPTED:
        raise KeyboardInterrupt
    if not step.result.exists():
        raise StepError(
            f"step {step.about!r} ended with exit code {code}; its message stands above. Mend that, then give the same "
            "command again: what is done is not done again"
        )
    return time.monotonic() - began_s


def run_command(words: Sequence[str]) -> int:
    """Run a spot-rl command in a process of its own, so that its memory, a GPU's included, is free afterwards.

    Raises:
        KeyboardInterrupt: Ctrl-C or a termination came meanwhile; the command has ended.
    """
    ended = run_in_foreground(module_command("spot_model", *words))
    if ended.is_interrupted:
        raise KeyboardInterrupt
    return ended.code
