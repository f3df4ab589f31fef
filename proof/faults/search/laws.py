"""What must hold at the end of a run, whatever went wrong in it."""

from __future__ import annotations

import traceback
from dataclasses import dataclass, field
from typing import Any, Final

from proof.faults.drive import Drive
from proof.faults.rig import Rig, tilt_rad
from proof.faults.rows import Finding, keep_invariants, left_alone, settle
from proof.faults.search.case import Case
from proof.faults.search.play import play

FALLEN_M: Final = 0.2
TIPPED_RAD: Final = 0.8


@dataclass
class Verdict:
    """How a case ended."""

    case: Case
    outcome: str
    problems: list[str] = field(default_factory=list)
    badness: float = 0.0
    """What the search climbs: problems above all, then how near the robot came to a fall."""


def judge_case(rig: Rig, case: Case) -> Verdict:
    """Run a case and judge its end. Leaves the robot for :meth:`Rig.restore`."""
    try:
        drive = rig.drive(*play(rig, case), when=case.when, seconds=case.seconds, at_s=0.0)
    except Exception as error:  # noqa: BLE001 - a run that breaks is what is searched for
        last = traceback.extract_tb(error.__traceback__)[-1]
        verdict = Verdict(case, "broke", [f"{type(error).__name__}: {error} ({last.filename}:{last.lineno})"])
        verdict.badness = 1000.0
        return verdict
    finding = Finding(drive.summary.outcome, truth=drive.truth)
    finding.demand(drive.summary.outcome != "internal_error", f"the runtime broke: {drive.summary.sentence}")
    _be_truthful(drive, finding)
    if drive.log is None:
        finding.problems.append(f"the log does not open: {drive.log_error}")
    else:
        finding.demand(
            drive.log.outcome == drive.summary.outcome or bool(drive.log.damage), f"the log says {drive.log.outcome}"
        )
        keep_invariants(drive.log, finding)
    settle(rig)
    left_alone(rig, finding)
    is_off = rig.status().motor_power.lower().endswith("off")
    finding.demand(is_off or drive.summary.exit_code != 0, "it says that all is well, and the motors have power")
    return Verdict(case, drive.summary.outcome, finding.problems, _badness(finding, drive.truth))


def _be_truthful(drive: Drive, finding: Finding) -> None:
    """A run whose robot fell is never reported as completed."""
    truth = drive.truth
    if truth is None or drive.summary.outcome not in ("completed", "operator_stop"):
        return
    is_down = truth.body_height_min_m < FALLEN_M or tilt_rad(truth) > TIPPED_RAD
    finding.demand(not is_down, f"the robot fell, and the run ended {drive.summary.outcome}")


def _badness(finding: Finding, truth: Any) -> float:
    near = 0.0 if truth is None else max(0.0, 0.5 - truth.body_height_min_m) + 0.2 * tilt_rad(truth)
    torque = 0.0 if truth is None else truth.peak_torque_nm / 1000.0
    return 100.0 * len(finding.problems) + near + torque
