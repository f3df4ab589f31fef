"""The search itself: random cases, and cases near those that ended worst."""

from __future__ import annotations

import signal
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from proof.bench_signals import raise_as_fault
from proof.faults.drive import Drive
from proof.faults.faulty_hal import FaultyHal
from proof.faults.rig import Rig, rig, tilt_rad
from proof.faults.rows import Finding, keep_invariants, left_alone, settle
from proof.faults.search.case import Case, Fault, draw, vary
from proof.faults.search.signals import SLOW, SpoiltSignal
from spot_model.io.signals import exit_on_termination

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

    def begin(hal: FaultyHal) -> None:
        for fault in case.faults:
            _plan(rig, hal, fault)

    try:
        drive = rig.drive(begin, when=case.when, seconds=case.seconds, at_s=0.0)
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


def _plan(rig: Rig, hal: FaultyHal, fault: Fault) -> None:
    kind, _, rest = fault.what.partition(" ")
    if kind == "inject":
        hal.plan(fault.at_s, lambda: rig.inject(rest, fault.lasts_s, **fault.values))
    elif kind == "signal":
        hal.plan(fault.at_s, lambda: raise_as_fault(signal.Signals[rest]))
    else:
        name, _, way = rest.partition(" ")
        spoilt = SpoiltSignal(name, way, int(float(fault.values["index"])), float(fault.values["size"]))
        if name in SLOW:
            hal.plan(fault.at_s, lambda: hal.spoil_slow(spoilt.slow, fault.lasts_s))
        else:
            hal.plan(fault.at_s, lambda: hal.spoil(spoilt, fault.lasts_s))


KEPT: Final = 12
"""Of the worst so far, from which others are varied."""

VARIED_SHARE: Final = 0.5


def searched(seed: int, minutes: float, policy: Path, folder: Path, scenario: str = "default") -> Iterator[Verdict]:
    """Try cases for some minutes; a robot that a case leaves unusable is replaced by a new one."""
    rng, until_s = np.random.default_rng(seed), time.monotonic() + 60.0 * minutes
    worst: list[Verdict] = []
    number = 0
    while time.monotonic() < until_s:
        number += 1
        with exit_on_termination(), rig(folder / f"robot{number}", policy, scenario=scenario) as robot:
            is_usable = True
            while is_usable and time.monotonic() < until_s:
                verdict = judge_case(robot, _next(worst, rng))
                worst = sorted([*worst, verdict], key=lambda v: -v.badness)[:KEPT]
                is_usable = _is_usable_after(robot)
                yield verdict


def _next(worst: list[Verdict], rng: np.random.Generator) -> Case:
    if len(worst) == KEPT and rng.random() < VARIED_SHARE:
        return vary(worst[int(rng.integers(len(worst)))].case, rng)
    return draw(rng)


def _is_usable_after(robot: Rig) -> bool:
    try:
        return not robot.restore()
    except Exception:  # noqa: BLE001 - whatever it is, the next case gets another robot
        return False
