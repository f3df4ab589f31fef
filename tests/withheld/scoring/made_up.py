"""Outcomes made by hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from spot_model.io.velocity_sequence import VelocitySequence, Waypoint
from withheld.cases import Case, CaseKind
from withheld.outcome import (
    Change,
    Consequences,
    Difference,
    Outcome,
    QuantityChange,
    StatedConsequences,
    Verdict,
)
from withheld.plan import Fault, Truth

KNEES = ("fl_kn", "fr_kn", "hl_kn", "hr_kn")


def fault(*names: str, joints: Sequence[str] = KNEES, size: float = 0.6, **parameters: float) -> Fault:
    return Fault(
        names=names,
        joints=tuple(joints),
        family="friction",
        size=size,
        parameters={k.replace("__", "."): v for k, v in parameters.items()},
    )


def said(
    name: str,
    *group: str,
    joints: Sequence[str] = KNEES,
    probability: float = 0.9,
    does: dict[str, tuple[float, float]] | None = None,
    **more: Any,
) -> Difference:
    changes = [QuantityChange(quantity=q, before=a, after=b) for q, (a, b) in (does or {}).items()]
    return Difference(
        name=name,
        probability=probability,
        group=(name, *group),
        joints=tuple(joints),
        consequences=StatedConsequences(changes=tuple(changes)),
        **more,
    )


def verdict(
    differences: Sequence[Difference] = (),
    status: str = "",
    *,
    unknown: float = 0.0,
    none: float = 0.0,
    **more: Any,
) -> Verdict:
    return Verdict(
        schema="spot-rl/verdict/2",
        status=status or ("explained" if differences else "calibration"),
        differences=tuple(differences),
        probability_none=none,
        probability_unknown=unknown,
        **more,
    )


def does(
    top: float = 0.0, power: float = 0.0, falls: float = 0.0, mean: float = 0.0, power_before: float = 200.0
) -> Consequences:
    """Of a robot at 2 m/s and 200 W that never falls."""
    return Consequences(
        top_speed=Change(before=2.0, after=2.0 + top),
        mean_speed=Change(before=1.0, after=1.0 + mean),
        power=Change(before=power_before, after=power_before + power),
        fall_share=Change(before=0.0, after=falls),
    )


def outcome(
    faults: Sequence[Fault] = (),
    differences: Sequence[Difference] = (),
    status: str = "",
    *,
    number: int = 0,
    kind: CaseKind = "single",
    without: Sequence[str] = (),
    moved: Sequence[float | None] | None = None,
    error_scale: float = 1.5,
    detail: str = "stream",
    told: dict[str, Any] | None = None,
    **more: Any,
) -> Outcome:
    """A case; ``told`` is what its verdict says beside its differences, status ``failed`` that there is none."""
    sequence = VelocitySequence(name="ahead", duration_s=1.0, waypoints=(Waypoint(time_s=0.0),))
    case = Case(
        number=number,
        kind=kind,
        requests=(),
        policy="walk",
        sequences=(sequence,),
        repeats=more.pop("repeats", 5),
        detail=detail,
        without=tuple(without),
        reality_seed=0,
        recording_seed=0,
        diagnosis_seed=0,
    )
    return Outcome(
        case=case,
        truth=Truth(faults=tuple(faults), error_scale=error_scale),
        verdict=None if status == "failed" else verdict(differences, status, **(told or {})),
        moved=tuple(moved) if moved is not None else tuple(4.0 for _ in faults),
        seconds={"diagnosis": 1.0},
        **more,
    )
