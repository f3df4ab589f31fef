"""One real run as the identification sees it: a log cut to the stretch under the policy."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from spot_log.read.run import Run
from spot_model.plant.start import StartState
from trainer.signals.policy_ticks import start_of


@dataclass(frozen=True, eq=False)
class LoggedRun(Run):
    """A run of one policy through one command sequence: its policy ticks, its commands by key, its states in order."""

    notes: tuple[str, ...] = ()
    """What was cut or is missing, in words."""
    has_policy_gains: bool = True
    """Whether it ran at the gains of the policy file that was given; otherwise only its torques are of use."""

    @classmethod
    def of(cls, run: Run, **changes: Any) -> LoggedRun:
        """The run with some of its fields, or of those that a log does not have, replaced."""
        return cls(**{**{f.name: getattr(run, f.name) for f in fields(Run)}, **changes})

    @property
    def source(self) -> str:
        """The file, for messages."""
        return str(self.path)

    @property
    def sequence(self) -> str:
        """Name of the command sequence."""
        return self.header.command_sequence or "unnamed"

    @property
    def repeat(self) -> int:
        """Which repeat of the sequence."""
        return self.header.repeat

    @property
    def policy_sha256(self) -> str:
        """Digest of the policy's file."""
        return self.header.policy_sha256

    @property
    def duration_s(self) -> float:
        """From the first policy tick to the last."""
        stamps = self.ticks.robot_stamp_ns
        return float(stamps[-1] - stamps[0]) * 1e-9 if len(stamps) else 0.0

    def start(self) -> StartState:
        """The robot at the first policy tick."""
        return start_of(self)
