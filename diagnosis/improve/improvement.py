"""What came out of an improvement, as data (``improve.json``) and in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Literal

from diagnosis.decision_constants import NAMED
from diagnosis.document import Verdict
from diagnosis.improve.judgement import PolicyFigure, is_taken
from diagnosis.improve.limits import Limit

SCHEMA: Final = "spot-rl/improvement/1"
ImprovementOutcome = Literal["improved", "kept", "nothing", "unknown"]


@dataclass(frozen=True)
class TakenStep:
    """A step that was taken."""

    about: str
    command: str
    seconds: float | None
    """None: its result was there."""


@dataclass(frozen=True)
class Improvement:
    """The outcome.

    ``improved``: the new policy is better, and worse in nothing that decides. ``kept``: it is not, so the old one
    stays. ``nothing``: the logs show no difference. ``unknown``: they show a gap that no effect explains, or cannot
    tell.
    """

    outcome: ImprovementOutcome
    policy: str
    limits: tuple[Limit, ...]
    figures: tuple[PolicyFigure, ...]
    steps: tuple[TakenStep, ...]
    notes: tuple[str, ...]
    """What has to be known beside the figures."""
    config: dict[str, Any]
    """What was asked for, with seed and revision."""

    @property
    def headline(self) -> str:
        """The outcome in a sentence."""
        if self.outcome == "nothing":
            return f"The logs show no difference to train for: {self.policy} stays as it is"
        if self.outcome == "unknown":
            return f"The logs do not tell what differs: {self.policy} was not trained further"
        better, worse = (", ".join(f.name for f in self.figures if f.kind == kind) for kind in ("better", "worse"))
        if self.outcome == "improved":
            return f"In simulation, the new policy is better: {better}" + (f"; worse: {worse}" if worse else "")
        why = f"the new one is worse: {worse}" if worse else "the new one is no better"
        return f"Keep the old policy: {why}" + (f" (better: {better})" if better else "")

    @property
    def sentences(self) -> list[str]:
        """What to do now."""
        if self.outcome == "improved":
            return [
                "improved.onnx holds the new policy. Its figures are simulated.",
                "Walk it slowly first, and diagnose its logs with the corrected model as nominal.",
            ]
        if self.outcome == "kept":
            return ["No improved.onnx was written."]
        if self.outcome == "unknown":
            return ["Record what the diagnosis' page advises, and improve again."]
        return ["No difference between robot and model is shown, and no limit that the model has wrong."]

    def to_data(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {"schema": SCHEMA, "headline": self.headline, **asdict(self)}


def worth_training(verdict: Verdict, limits: Sequence[Limit]) -> ImprovementOutcome | None:
    """Why nothing is trained; None where the logs give a training something to learn from."""
    if any(d.is_found for d in verdict.differences) or any(limit.differs for limit in limits):
        return None
    is_open = verdict.status in ("unknown_effect", "cannot_tell") or verdict.probability_unknown > NAMED
    return "unknown" if is_open else "nothing"


def outcome_of(figures: tuple[PolicyFigure, ...]) -> ImprovementOutcome:
    """Whether the new policy is taken."""
    return "improved" if is_taken(figures) else "kept"


def step_names(folder: Path) -> dict[str, Path]:
    """Where each step leaves its result."""
    return {
        "verdict": folder / "diagnosis" / "verdict.json",
        "possible": folder / "diagnosis" / "possible_robots.yaml",
        "corrected": folder / "diagnosis" / "corrected_model.yaml",
        "search": folder / "identify.yaml",
        "identified": folder / "identification" / "result.json",
        "robots": folder / "robots.yaml",
        "training": folder / "training",
        "refine": folder / "refine.yaml",
        "refined": folder / "refinement" / "refinement.json",
        "retrained": folder / "retrained.onnx",
        "old": folder / "evaluation-old" / "evaluation.json",
        "new": folder / "evaluation-new" / "evaluation.json",
        "improved": folder / "improved.onnx",
        "page": folder / "improve.html",
        "data": folder / "improve.json",
        "inputs": folder / "inputs.json",
    }
