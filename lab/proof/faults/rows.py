"""What a row of the fault matrix is, and when it counts as passed."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final

import numpy as np

from proof.faulty import ending_the_bench
from proof.rig import Drive, Rig
from spot_log import Run
from spot_model.robot import facts

NS_PER_MS: Final = 1_000_000
AT_REST_RAD_S: Final = 0.5
SETTLE_S: Final = 6.0
"""Robot time after a run in which the robot must come to rest by itself."""

HUNG_S: Final = 300.0
"""Host time after which a row counts as one that hangs."""

HUNG_LONG_S: Final = 1800.0
"""Host time after which a row with five minutes of robot time counts as one that hangs; a busy computer is slow."""

SETTLE_PART_S: Final = 0.25
STILL_PARTS: Final = 2
"""A robot without power that was still for this many parts stays still."""


@dataclass
class Finding:
    """What a row has found; problems in words, none when it passed."""

    reaction: str = ""
    reaction_ms: float = 0.0
    """0 where nothing is timed."""
    problems: list[str] = field(default_factory=list)
    log_ok: bool = True
    truth: Any = None

    def demand(self, holds: bool, otherwise: str) -> None:
        """Note a problem unless this holds."""
        if not holds:
            self.problems.append(otherwise)


@dataclass(frozen=True)
class Row:
    """One fault, and how it is tried."""

    fault: str
    bound_ms: float
    attempt: Callable[[Rig], Finding]
    is_real_time: bool = False
    """Also tried in real time."""
    is_long: bool = False
    """Takes long; left out where rows are tried quickly."""
    is_host_time: bool = False
    """Its reaction is timed by the host's clock, so it also depends on the host's other work."""
    is_alone: bool = False
    """Has a robot of its own: it leaves one that a person must see to first, or its end hangs on the gait's phase."""


@dataclass(frozen=True)
class Result:
    """A row as it is printed."""

    fault: str
    reaction: str
    reaction_ms: float
    bound_ms: float
    ok: bool
    body_height_min_m: float | None
    peak_torque_nm: float | None
    log_ok: bool
    problems: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """The outcome as JSON, with problems only where there are any."""
        values = asdict(self)
        problems = values.pop("problems")
        return values if self.ok else {**values, "problems": list(problems)}


def try_row(rig: Rig, row: Row) -> Result:
    """Try a row; whatever goes wrong, a traceback included, is its problem."""
    began_s = time.monotonic()
    try:
        rig.truth(reset_extremes=True)
        with ending_the_bench():
            finding = row.attempt(rig)
    except Exception as error:  # noqa: BLE001 - a row that breaks is a row that failed
        finding = Finding("broke", problems=[where_it_broke(error)], log_ok=False)
    height_m, torque_nm = None, None
    try:
        truth = finding.truth or rig.truth()
        height_m, torque_nm = round(truth.body_height_min_m, 3), round(truth.peak_torque_nm, 1)
        settle(rig)
        left_alone(rig, finding)
    except Exception as error:  # noqa: BLE001 - as above
        finding.problems.append(f"the robot cannot be looked at afterwards: {type(error).__name__}: {error}")
    finding.demand(finding.reaction_ms <= row.bound_ms, f"reacted after {finding.reaction_ms:.1f} ms")
    hung_s = time.monotonic() - began_s
    finding.demand(hung_s < (HUNG_LONG_S if row.is_long else HUNG_S), f"took {hung_s:.0f} s")
    return Result(
        row.fault,
        finding.reaction,
        round(finding.reaction_ms, 1),
        row.bound_ms,
        not finding.problems and finding.log_ok,
        height_m,
        torque_nm,
        finding.log_ok,
        tuple(finding.problems),
    )


def where_it_broke(error: Exception) -> str:
    """Return an error in a line, with the place that raised it."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({last.filename}:{last.lineno})"


def tidy(rig: Rig, row: Row, result: Result) -> Result:
    """Restore the robot for the next row; a row fails if that is not possible, and names what it left."""
    if row.is_alone:
        return result
    try:
        left = rig.restore()
    except Exception as error:  # noqa: BLE001 - as above
        left = f"a robot that cannot be restored: {type(error).__name__}: {error}"
    return replace(result, ok=False, problems=(*result.problems, f"left {left}")) if left else result


# What every run must keep --------------------------------------------------------------------------------------------


def settle(rig: Rig) -> None:
    """Let robot time pass until the robot rests without power, or :data:`SETTLE_S` are over."""
    still = 0
    for _ in range(round(SETTLE_S / SETTLE_PART_S)):
        rig.step(SETTLE_PART_S)
        speed_rad_s = float(np.abs(rig.truth().joint_velocity_rad_s).max())
        still = still + 1 if not rig.is_powered and speed_rad_s < AT_REST_RAD_S / 10.0 else 0
        if still == STILL_PARTS:
            return


def left_alone(rig: Rig, finding: Finding) -> None:
    """Check that the robot is not left stiff and unattended."""
    status, truth = rig.status(), rig.truth()
    mode, power = status.mode.lower(), status.motor_power.lower()
    is_attended = bool(status.lease_owner) and not status.lease_owner.startswith("spot-rl")
    is_limp = power.endswith("off") or mode in ("sitting", "damping", "limp")
    finding.demand(is_limp or is_attended, f"left {mode} with motors {power} and nobody in charge")
    finding.demand("joint_control" not in mode, "left in joint control")
    speed_rad_s = float(np.abs(truth.joint_velocity_rad_s).max())
    finding.demand(speed_rad_s < AT_REST_RAD_S, f"a joint still moves at {speed_rad_s:.2f} rad/s")


def judge(drive: Drive, *outcomes: str, incident: bool = True) -> Finding:
    """Check what every run must keep: outcome, a log that opens and says so, limits, keys, end times, incident file."""
    summary, finding = drive.summary, Finding(drive.summary.outcome, truth=drive.hal.truth)
    finding.demand(summary.outcome in outcomes, f"ended {summary.outcome}: {summary.sentence}")
    finding.demand(drive.happened_ns > 0, "the fault never happened")
    log, error = drive.opened
    if log is None:
        finding.log_ok = False
        finding.problems.append(f"the log does not open: {error}")
        return finding
    finding.demand(log.outcome == summary.outcome or bool(log.damage), f"the log says {log.outcome}")
    keep_invariants(log, finding)
    if incident and 20 <= summary.exit_code < 80:
        kept = drive.incident
        finding.demand(kept is not None and len(kept.states) > 0, "there is no incident file")
    return finding


def keep_invariants(log: Run, finding: Finding) -> None:
    """Check every command that was sent, from first to last."""
    commands = log.commands
    if len(commands.key) == 0:
        return
    position = commands.position_rad
    is_within = bool((position >= facts.POSITION_LOW_RAD).all() and (position <= facts.POSITION_HIGH_RAD).all())
    finding.demand(bool(np.isfinite(position).all()) and is_within, "a set-point outside the limits was sent")
    finding.demand(bool((np.diff(commands.key) > 0).all()), "keys do not rise")
    ahead_ns = commands.end_robot_stamp_ns - commands.robot_stamp_ns
    finding.demand(bool(((ahead_ns > 0) & (ahead_ns <= 100 * NS_PER_MS)).all()), "an end time out of range was sent")
    soft = (commands.kp_nm_per_rad == 0.0).all(axis=1)
    if soft.any():
        first = int(np.argmax(soft))
        finding.demand(bool(soft[first:].all()), "something other than damping followed damping")
    used = commands.state_robot_stamp_ns[commands.state_robot_stamp_ns > 0]
    finding.demand(bool((np.diff(used) >= 0).all()), "an older state was used after a newer one")
