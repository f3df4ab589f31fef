"""What is known of one case after its seal was opened: truth, the verdict after each round, sizes, times."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from withheld.cases.draw import Case
from withheld.plan import Truth
from withheld.verdict import Verdict

SCHEMA: Final = "spot-rl/withheld-case/2"


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class Round(_Part):
    """A verdict after so many experiments that the diagnosis asked for; the first round is of the first logs alone."""

    experiments: int = 0
    robot_s: float = 0.0
    """Time on the robot that the experiments took, s."""
    verdict: Verdict | None = None
    """None where the diagnosis ended without one; it counts as a wrong answer."""


class Outcome(_Part):
    """One case."""

    schema_name: Literal["spot-rl/withheld-case/2"] = Field(default=SCHEMA, alias="schema")
    case: Case
    truth: Truth
    rounds: tuple[Round, ...]
    moved: tuple[float | None, ...] = ()
    """How far each fault moves the gap: (D − floor)/floor, with D between this robot and the same one without that
    fault. None where it cannot be measured: the robot falls at once."""
    true_s: float | None = None
    """S of the delivered model on sequences that neither fit nor verdict saw."""
    paper: str | None = None
    """What the paper's way names; empty for no gap, None where it was not tried."""
    metadata: dict[str, float] = Field(default_factory=dict)
    """What can be known of the logs without their signals: sizes, counts, stamps, digits of names."""
    seal: str
    verdict_sha256: str
    locked_in: str
    seconds: dict[str, float]
    """Of one core, by stage."""
    problem: str = ""

    @property
    def verdict(self) -> Verdict | None:
        """Of the first round."""
        return self.rounds[0].verdict

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
