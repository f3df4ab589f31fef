"""What the generator and the judge agree on: faults, truth, what is recorded, and what a reality can do."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal, Protocol

from pydantic import Field

from spot_model.io.model_file import RobotModel
from spot_model.io.settings import Settings
from spot_model.io.velocity_sequence import VelocitySequence

Family = Literal[
    "friction",
    "drive",
    "limits",
    "supply",
    "thermal",
    "transport",
    "sensing",
    "estimator",
    "body",
    "ground",
    "software",
    "learned",
]
Place = Literal["joint", "type", "leg", "all", "body"]
"""At which kind of place a fault acts; ``body`` is not a matter of joints."""
Signal = Literal["battery", "contact", "load", "imu", "temperature", "receipts"]
SIGNALS: Final[tuple[Signal, ...]] = ("battery", "contact", "load", "imu", "temperature", "receipts")
IMPORT_LACKS: Final[frozenset[Signal]] = frozenset({"battery", "contact", "temperature", "receipts"})
Detail = Literal["stream", "import"]
"""What a log holds: the whole state stream with ticks, or what a foreign recording has at 50 to 60 Hz."""


class Fault(Settings):
    """One thing that is different in a reality."""

    names: tuple[str, ...]
    """Library effects that are a right answer; empty: the library has no such effect."""
    joints: tuple[str, ...]
    """Canonical names of the joints at which it acts; empty: no matter of joints."""
    parameters: dict[str, float] = Field(default_factory=dict)
    """``effect.parameter`` and the value that a perfect diagnosis would state, where the library's has a meaning."""
    family: Family
    size: float = Field(gt=0.0, le=1.0)
    """Place on the ladder: 0 is nothing, 1 the end of the realistic range."""
    kind: str = ""
    """The catalogue's own name of it."""


class Truth(Settings):
    """What a perfect diagnosis would find."""

    faults: tuple[Fault, ...]
    """Empty: nothing is different beyond the ordinary errors that every reality has."""
    error_scale: float = Field(default=1.0, gt=0.0)
    """Scale of the ordinary errors of this robot."""


class FaultRequest(Settings):
    """One fault that a case asks for."""

    kind: str
    """Key of a catalogue."""
    place: Place
    size: float = Field(gt=0.0, le=1.0)


@dataclass(frozen=True)
class RecordingPlan:
    """What a reality records."""

    policy: Path
    """The policy's ONNX file."""
    sequences: tuple[VelocitySequence, ...]
    repeats: int
    seed: int
    """Seed of all that differs from run to run: starts, noise, delays, opaque names."""
    missing: frozenset[Signal] = field(default_factory=frozenset)
    """Signals that the logs lack."""
    detail: Detail = "stream"


class Reality(Protocol):
    """A robot that nobody but the judge knows; ``module:Class`` with a constructor ``(seed: int)`` plugs one in."""

    def record(self, plan: RecordingPlan, folder: Path) -> None:
        """Write ``repeats`` logs of each sequence into a folder, as ``<opaque>.mcap``."""

    @property
    def truth(self) -> Truth:
        """What is different."""

    @property
    def nominal(self) -> RobotModel:
        """The model that the diagnosis is given: the reality without its faults and its small errors."""
