"""What is known of one case after its seal was opened: truth, verdict in short, baselines' answers, times."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

from diagnosis.verdict import FoundEffect, Number, Status, Verdict
from withheld.cases.draw import Case
from withheld.plan import Truth

SCHEMA: Final = "spot-rl/withheld-case/1"


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class Said(_Part):
    """One effect of a verdict."""

    name: str
    probability: float
    group: tuple[str, ...]
    joints: tuple[str, ...]
    parameters: dict[str, Number]
    split_by: str
    gain_nats: float

    @staticmethod
    def of(effect: FoundEffect) -> Said:
        """Of a verdict's effect."""
        return Said(
            name=effect.name,
            probability=effect.probability,
            group=effect.group,
            joints=effect.joints,
            parameters=effect.parameters,
            split_by=effect.split_by,
            gain_nats=effect.gain_nats,
        )


class ShrinkSaid(_Part):
    """The verdict's shrink, and the true one where it was measured."""

    d0: float
    d1: float
    floor: float
    s: float | None
    low: float | None
    high: float | None
    placebo: float | None
    true_s: float | None = None
    """Of the stated model, from new sequences and more runs of the reality."""


class Answer(_Part):
    """What a baseline says."""

    has_gap: bool
    effect: str = ""
    """Empty: it names none."""
    joints: tuple[str, ...] = ()
    detail: dict[str, float | None] = Field(default_factory=dict)
    """Figures; None for one that these logs do not give."""
    cpu_s: float = 0.0

    @field_validator("detail")
    @classmethod
    def _finite(cls, detail: dict[str, float | None]) -> dict[str, float | None]:
        """No number is no figure: JSON has no word for it, and the outcome is to be read again."""
        return {name: v if v is not None and math.isfinite(v) else None for name, v in detail.items()}


class Outcome(_Part):
    """One case."""

    schema_name: Literal["spot-rl/withheld-case/1"] = Field(default=SCHEMA, alias="schema")
    case: Case
    truth: Truth
    status: Status | Literal["failed"]
    """failed: the diagnosis ended without a verdict; it counts as a wrong answer."""
    effects: tuple[Said, ...] = ()
    probability_none: float = 0.0
    probability_unknown: float = 0.0
    unknown_joints: tuple[str, ...] = ()
    log_advice: tuple[str, ...] = ()
    shrink: ShrinkSaid | None = None
    moved: float | None = None
    """How far the faults move the headline measure: (D − floor)/floor, D between this robot with and without them."""
    baselines: dict[str, Answer] = Field(default_factory=dict)
    metadata: dict[str, float] = Field(default_factory=dict)
    """What can be known of the logs without their signals: sizes, counts, stamps, digits of names."""
    seal: str
    verdict_sha256: str
    locked_in: str
    seconds: dict[str, float]
    """Of one core, by stage."""
    problem: str = ""

    def with_verdict(self, verdict: Verdict) -> Outcome:
        """The same with what a verdict says."""
        s = verdict.shrink
        return self.model_copy(
            update={
                "status": verdict.status,
                "effects": tuple(Said.of(e) for e in verdict.effects),
                "probability_none": verdict.probability_none,
                "probability_unknown": verdict.probability_unknown,
                "unknown_joints": verdict.unknown.joints if verdict.unknown else (),
                "log_advice": verdict.log_advice,
                "shrink": None
                if s is None
                else ShrinkSaid(
                    d0=s.d0,
                    d1=s.d1,
                    floor=s.floor,
                    s=s.s,
                    low=s.s_low,
                    high=s.s_high,
                    placebo=s.placebo.s if s.placebo else None,
                ),
            }
        )


def load_outcome(path: Path) -> Outcome:
    """Read a case's ``outcome.json``.

    Raises:
        pydantic.ValidationError: It does not follow the schema.
    """
    return Outcome.model_validate_json(path.read_text(encoding="utf-8"))
