"""What is known of one case after its seal was opened: truth, verdict, what its faults do, times."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from withheld.cases.draw import Case
from withheld.features import Gap
from withheld.plan import Truth
from withheld.verdict import Verdict

SCHEMA: Final = "spot-rl/withheld-case/3"


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class Change(_Part):
    """A quantity of the robot without a fault and with it; None where no run is long enough."""

    before: float | None
    after: float | None

    @property
    def of(self) -> float | None:
        """With the fault less without it."""
        return None if self.before is None or self.after is None else self.after - self.before


class Consequences(_Part):
    """What a fault truly does in the case's commands, measured up to a fall; named as a verdict names it."""

    top_speed: Change
    """Forward, held for a second, in the fastest sequence, m/s."""
    mean_speed: Change
    """Forward, m/s."""
    power: Change
    """Mean positive power of the joints, W."""
    fall_share: Change
    """Of the runs."""


class Outcome(_Part):
    """One case."""

    schema_name: Literal["spot-rl/withheld-case/3"] = Field(default=SCHEMA, alias="schema")
    case: Case
    truth: Truth
    verdict: Verdict | None
    """None where the diagnosis ended without one; it counts as a wrong answer."""
    moved: tuple[float | None, ...] = ()
    """How far each fault moves the gap: (D − floor)/floor, with D between this robot and the same one without that
    fault. None where it cannot be measured: the robot falls at once."""
    consequences: tuple[Consequences | None, ...] = ()
    """Of each fault, from the same runs; None where these broke down."""
    true_s: float | None = None
    """S of the delivered model on sequences that neither fit nor verdict saw."""
    true_gaps: dict[Gap, float] = Field(default_factory=dict)
    """The same of each of the three gaps that the nominal model has."""
    metadata: dict[str, float] = Field(default_factory=dict)
    """What can be known of the logs without their signals: sizes, counts, stamps, digits of names."""
    seal: str
    verdict_sha256: str
    locked_in: str
    seconds: dict[str, float]
    """Of one core, by stage."""
    problem: str = ""

    @property
    def status(self) -> str:
        """In one word."""
        return self.verdict.status if self.verdict is not None else "failed"


def load_outcome(path: Path) -> Outcome:
    """Read a case's ``outcome.json``.

    Raises:
        pydantic.ValidationError: It does not follow the schema.
    """
    return Outcome.model_validate_json(path.read_text(encoding="utf-8"))
