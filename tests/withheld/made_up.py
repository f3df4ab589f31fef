"""Outcomes made by hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from spot_model.io.velocity_sequence import VelocitySequence, Waypoint
from withheld.cases.draw import Case, CaseKind
from withheld.scoring.outcome import Outcome, Said, ShrinkSaid
from withheld.plan import Fault, Truth

KNEES = ("fl_kn", "fr_kn", "hl_kn", "hr_kn")


def fault(*names: str, joints: Sequence[str] = KNEES, size: float = 0.6, **parameters: float) -> Fault:
    return Fault(
        names=names, joints=tuple(joints), family="friction", size=size,
        parameters={k.replace("__", "."): v for k, v in parameters.items()},
    )


def said(name: str, *group: str, joints: Sequence[str] = KNEES, probability: float = 0.9, **more: Any) -> Said:
    return Said(
        name=name, probability=probability, group=(name, *group), joints=tuple(joints),
        parameters=more.get("parameters", {}), split_by="", gain_nats=100.0,
    )


def outcome(
    faults: Sequence[Fault] = (), effects: Sequence[Said] = (), status: str = "", *, number: int = 0,
    kind: CaseKind = "known", without: Sequence[str] = (), **more: Any,
) -> Outcome:
    sequence = VelocitySequence(name="ahead", duration_s=1.0, waypoints=(Waypoint(time_s=0.0),))
    case = Case(
        number=number, kind=kind, requests=(), policy="walk", sequences=(sequence,), repeats=more.pop("repeats", 5),
        missing=(), without=tuple(without), reality_seed=0, recording_seed=0, diagnosis_seed=0,
    )
    shrink = more.pop("s", None)
    return Outcome(
        case=case, truth=Truth(faults=tuple(faults)), effects=tuple(effects),
        status=status or ("explained" if effects else "no_gap"), seal="", verdict_sha256="", locked_in="",
        seconds={"diagnosis": 1.0},
        shrink=None if shrink is None else ShrinkSaid(d0=3, d1=1, floor=1, s=shrink, low=shrink - 0.1,
                                                      high=shrink + 0.1, placebo=0.1, true_s=0.85),
        **more,
    )
