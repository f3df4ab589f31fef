"""A verdict as the judge reads it: what it scores and nothing else, so that any other field may come or go."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from spot_model.errors import BadInputError
from spot_model.io.validation import explain

UNKNOWN_FROM: Final = 0.5
"""A verdict that explains a part calls the rest unknown from this probability on."""


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True, populate_by_name=True)


class Number(_Part):
    """A stated number with its 90 % interval."""

    value: float
    low: float
    high: float


class QuantityChange(_Part):
    """A quantity of simulated runs without something and with it."""

    quantity: str
    before: float | None
    after: float | None


class Consequences(_Part):
    """What a difference is said to do."""

    changes: tuple[QuantityChange, ...] = ()


class Difference(_Part):
    """One stated difference, or a group of rivals that the logs cannot part."""

    name: str
    probability: float = Field(ge=0.0, le=1.0)
    group: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    parameters: dict[str, Number] = Field(default_factory=dict)
    by_type: dict[str, dict[str, Number]] = Field(default_factory=dict)
    """The same by joint type (``hx``, ``hy``, ``kn``), where one number does not serve."""
    rivals: dict[str, float] = Field(default_factory=dict)
    consequences: Consequences | None = None

    @property
    def names(self) -> frozenset[str]:
        """The difference and its rivals."""
        return frozenset({self.name, *self.group})


class CalibratedNumber(_Part):
    """One of the robot's own numbers."""

    title: str = ""
    where: str = ""
    nominal: float
    value: float
    stands_out: bool = False


class Calibration(_Part):
    """The robot's own numbers."""

    numbers: tuple[CalibratedNumber, ...] = ()


class Formula(_Part):
    """A formula for what is unknown."""

    predicted_share: float
    """Of the remaining residual, in runs that it was not fitted to."""


class Unknown(_Part):
    """What the library does not explain."""

    formula: Formula | None = None


class Shrink(_Part):
    """How far the verdict says that the gap goes away."""

    d0: float
    d1: float
    floor: float
    s: float | None


class Verdict(_Part):
    """One verdict."""

    schema_name: Literal["spot-rl/verdict/2"] = Field(alias="schema")
    status: str
    differences: tuple[Difference, ...]
    calibration: Calibration = Calibration()
    probability_none: float
    probability_unknown: float
    unknown: Unknown | None = None
    shrink: Shrink | None = None

    @property
    def is_unknown(self) -> bool:
        """Whether it says that something is there which no effect of the library is."""
        is_in_part = self.status == "partly_explained" and self.probability_unknown > UNKNOWN_FROM
        return self.status == "unknown_effect" or is_in_part


def read_verdict(path: Path) -> Verdict:
    """Read a ``verdict.json``.

    Raises:
        BadInputError: It cannot be read, or lacks what is scored.
    """
    try:
        return Verdict.model_validate_json(path.read_text(encoding="utf-8"))
    except (OSError, ValidationError) as error:
        reason = explain(error) if isinstance(error, ValidationError) else str(error)
        raise BadInputError(f"{path} cannot be scored: {reason}") from error
