"""Outcomes made by hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from spot_model.io.velocity_sequence import VelocitySequence, Waypoint
from withheld.cases.draw import Case
from withheld.cases.protocol import CaseKind
from withheld.outcome import Outcome, Round
from withheld.plan import Fault, Truth
from withheld.verdict import Said, Unknown, Verdict

KNEES = ("fl_kn", "fr_kn", "hl_kn", "hr_kn")


def fault(*names: str, joints: Sequence[str] = KNEES, size: float = 0.6, **parameters: float) -> Fault:
    return Fault(
        names=names,
        joints=tuple(joints),
        family="friction",
        size=size,
        parameters={k.replace("__", "."): v for k, v in parameters.items()},
    )


def said(name: str, *group: str, joints: Sequence[str] = KNEES, probability: float = 0.9, **more: Any) -> Said:
    return Said(name=name, probability=probability, group=(name, *group), joints=tuple(joints), **more)


def verdict(effects: Sequence[Said] = (), status: str = "", unknown_joints: Sequence[str] = (), **more: Any) -> Verdict:
    return Verdict(
        status=status or ("explained" if effects else "no_gap"),
        effects=tuple(effects),
        unknown=Unknown(joints=tuple(unknown_joints)) if unknown_joints else None,
        **more,
    )


def outcome(
    faults: Sequence[Fault] = (),
    effects: Sequence[Said] = (),
    status: str = "",
    *,
    number: int = 0,
    kind: CaseKind = "single",
    without: Sequence[str] = (),
    moved: Sequence[float | None] | None = None,
    error_scale: float = 1.5,
    detail: str = "stream",
    rounds: Sequence[Round] = (),
    unknown_joints: Sequence[str] = (),
    **more: Any,
) -> Outcome:
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
    first = Round(verdict=None if status == "failed" else verdict(effects, status, unknown_joints))
    return Outcome(
        case=case,
        truth=Truth(faults=tuple(faults), error_scale=error_scale),
        rounds=(first, *rounds),
        moved=tuple(moved) if moved is not None else tuple(4.0 for _ in faults),
        seal="",
        verdict_sha256="",
        locked_in="",
        seconds={"diagnosis": 1.0},
        **more,
    )
