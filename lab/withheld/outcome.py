"""What is known of one case after its verdict: truth, verdict as far as it is scored, what its faults do."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from spot_model.errors import BadInputError
from spot_model.io.settings import explain
from withheld.cases import Case
from withheld.plan import Truth

UNKNOWN_FROM: Final = 0.5
"""A verdict that explains a part calls the rest unknown from this probability on."""
Gap = Literal["torque", "joint motion", "body motion"]
GAPS: Final[tuple[Gap, ...]] = ("torque", "joint motion", "body motion")


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class _Read(BaseModel):
    """Part of a verdict: what is scored and nothing else, so that any other field may come or go."""

    model_config = ConfigDict(extra="ignore", frozen=True, populate_by_name=True)


class Change(_Part):
    """A quantity of the robot without something and with it; None where no run is long enough."""

    before: float | None
    after: float | None

    @property
    def of(self) -> float | None:
        """With it less without it."""
        return None if self.before is None or self.after is None else self.after - self.before


# A verdict ------------------------------------------------------------------------------------------------------------


class Number(_Read):
    """A stated number with its 90 % interval."""

    value: float
    low: float
    high: float


class QuantityChange(Change):
    """A quantity of simulated runs, by name."""

    model_config = ConfigDict(extra="ignore")
    quantity: str


class StatedConsequences(_Read):
    """What a difference is said to do."""

    changes: tuple[QuantityChange, ...] = ()


class Difference(_Read):
    """One stated difference, or a group of rivals that the logs cannot part."""

    name: str
    probability: float = Field(ge=0.0, le=1.0)
    group: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    parameters: dict[str, Number] = Field(default_factory=dict)
    by_type: dict[str, dict[str, Number]] = Field(default_factory=dict)
    """Parameters by joint type (``hx``, ``hy``, ``kn``), where one number does not serve."""
    rivals: dict[str, float] = Field(default_factory=dict)
    consequences: StatedConsequences | None = None

    @property
    def names(self) -> frozenset[str]:
        """The difference and its rivals."""
        return frozenset({self.name, *self.group})


class CalibratedNumber(_Read):
    """One of the robot's own numbers."""

    title: str = ""
    where: str = ""
    nominal: float
    value: float
    stands_out: bool = False


class Calibration(_Read):
    """The robot's own numbers."""

    numbers: tuple[CalibratedNumber, ...] = ()


class Shrink(_Read):
    """How far the verdict says that the gap goes away."""

    d0: float
    d1: float
    floor: float
    s: float | None


class Verdict(_Read):
    """One verdict."""

    schema_name: Literal["spot-rl/verdict/2"] = Field(alias="schema")
    status: str
    differences: tuple[Difference, ...]
    calibration: Calibration = Calibration()
    probability_none: float
    probability_unknown: float
    shrink: Shrink | None = None

    @property
    def is_unknown(self) -> bool:
        """Whether it says that something is there which no effect of the library is."""
        is_in_part = self.status == "partly_explained" and self.probability_unknown > UNKNOWN_FROM
        return self.status == "unknown_effect" or is_in_part


# A case ---------------------------------------------------------------------------------------------------------------


class Consequences(_Part):
    """What a fault truly does in the case's commands, measured up to a fall; named as a verdict names it."""

    top_speed: Change
    """Forward, held for a second, in the fastest sequence, m/s."""
    mean_speed: Change
    """Forward, m/s."""
    power: Change
    """Mean positive power of the joints, W."""
    fall_share: Change
    """Share of the runs that fall."""


class Outcome(_Part):
    """One case."""

    schema_name: Literal["spot-rl/withheld-case/4"] = Field(default="spot-rl/withheld-case/4", alias="schema")
    case: Case
    truth: Truth
    verdict: Verdict | None
    """None where the diagnosis ended without one; it counts as a wrong answer."""
    moved: tuple[float | None, ...] = ()
    """How far each fault moves the gap: (D − floor)/floor, with D between this robot and the same one without that
    fault. None where it cannot be measured: the robot falls at once."""
    consequences: tuple[Consequences | None, ...] = ()
    """Consequences of each fault, from the same runs; None where these broke down."""
    true_s: float | None = None
    """S of the delivered model on sequences that neither fit nor verdict saw."""
    true_gaps: dict[Gap, float] = Field(default_factory=dict)
    """S of each of the three gaps that the nominal model has."""
    seconds: dict[str, float]
    """Seconds of one core, by stage."""
    problem: str = ""

    @property
    def status(self) -> str:
        """In one word."""
        return self.verdict.status if self.verdict is not None else "failed"


Read = TypeVar("Read", Verdict, Outcome)


def read_verdict(path: Path) -> Verdict:
    """Read a ``verdict.json``.

    Raises:
        BadInputError: It cannot be read, or lacks what is scored.
    """
    return _read(Verdict, path, "cannot be scored")


def read_outcome(path: Path) -> Outcome:
    """Read a case's ``outcome.json``.

    Raises:
        BadInputError: It cannot be read, or does not follow the schema.
    """
    return _read(Outcome, path, "does not follow its schema")


def _read(model: type[Read], path: Path, problem: str) -> Read:
    try:
        return model.model_validate_json(path.read_text(encoding="utf-8"))
    except (OSError, ValidationError) as error:
        reason = explain(error) if isinstance(error, ValidationError) else str(error)
        raise BadInputError(f"{path} {problem}: {reason}") from error
