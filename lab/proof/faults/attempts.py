"""The ways in which rows try a fault: what happens in a run, and what must come of it."""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from proof.faults.rows import NS_PER_MS, Finding, Row, judge
from proof.faulty import FaultyHal, raise_as_fault
from proof.rig import Drive, Rig
from spot_log import Run
from spot_model.robot.state import RobotState, SlowState

Act = Callable[[Rig, FaultyHal], object]
"""Something that happens in a run."""
Check = Callable[[Rig, Drive, Finding], object]
"""Something that must hold after a run."""

SOFT: Final = ("damping", "released")
"""Damping or silence, whichever comes first."""
AT_ONCE_MS: Final = 25.0
"""A policy period, and the link's few milliseconds."""


def row(
    fault: str,
    bound_ms: float,
    act: Act,
    *outcomes: str,
    way: str | tuple[str, ...] = (),
    since: Callable[[Drive], int] = lambda drive: drive.happened_ns,
    missed: int | None = None,
    checks: tuple[Check, ...] = (),
    incident: bool = True,
    is_real_time: bool = False,
    is_long: bool = False,
    is_host_time: bool = False,
    is_alone: bool = False,
    **options: Any,
) -> Row:
    """Make a row of a run in which something happens once.

    Args:
        fault: The row's name.
        bound_ms: How soon the reaction must come.
        act: What happens.
        outcomes: How the run may end.
        way: Mode or event that must follow; its delay is timed. Of several, the one that comes first.
        since: Robot clock from which the delay counts.
        missed: How many ticks may be missed; None: any number.
        checks: What must hold besides.
        incident: Whether an end by the safety core must leave an incident file.
        is_real_time: See :class:`Row`, as the three after it.
        is_long: See there.
        is_host_time: See there.
        is_alone: See there.
        options: Of :meth:`Rig.drive`.
    """

    def attempt(rig: Rig) -> Finding:
        drive = rig.drive(lambda hal: act(rig, hal), **options)
        finding = judge(drive, *outcomes, incident=incident)
        ticks = drive.summary.skipped_ticks
        finding.demand(missed is None or ticks <= missed, f"{ticks} ticks were missed")
        if drive.opened[0] is None:
            return finding
        if way:
            reacted(drive, finding, (way,) if isinstance(way, str) else way, since(drive))
        for check in checks:
            check(rig, drive, finding)
        return finding

    return Row(fault, bound_ms, attempt, is_real_time, is_long, is_host_time, is_alone)


def reacted(drive: Drive, finding: Finding, ways: tuple[str, ...], since_ns: int) -> None:
    """Time how long it took until one of the modes (or events) began."""
    came = [(at_ns, way) for way in ways if (at_ns := drive.event_ns(way)) is not None]
    finding.demand(bool(came), f"there was no {ways[0]}")
    if came:
        at_ns, way = min(came)
        finding.reaction += f" → {way}"
        finding.reaction_ms = (at_ns - since_ns) / NS_PER_MS


# What happens --------------------------------------------------------------------------------------------------------


def inject(name: str, lasts_s: float = 0.0, /, **parameters: float | str) -> Act:
    """Make the act of a fault of the fake robot; 0 s: until it is cleared."""
    return lambda rig, _: rig.inject(name, lasts_s, **parameters)


def raise_signals(*numbers: signal.Signals) -> Act:
    """Make the act of signals to this process, in turn."""

    def act(_: Rig, __: FaultyHal) -> None:
        for number in numbers:
            raise_as_fault(number)

    return act


def all_of(*acts: Act) -> Act:
    """Make one act of several, in one instant."""
    return lambda rig, hal: [act(rig, hal) for act in acts]


def spoil(spoilt: Callable[[RobotState], RobotState | None]) -> Act:
    """Make the act from which on states arrive changed, or not at all."""
    return lambda _, hal: hal.spoil(spoilt)


def spoil_slow(spoilt: Callable[[SlowState], SlowState], lasts_s: float = 0.0) -> Act:
    """Make the act from which on what is polled arrives changed; 0 s: to the end."""
    return lambda _, hal: hal.spoil_slow(spoilt, lasts_s)


# What must hold ------------------------------------------------------------------------------------------------------


def is_told(event: str, *, is_wanted: bool = True) -> Check:
    """Make the check that an event of this name has come, or has not."""

    def check(_: Rig, drive: Drive, finding: Finding) -> None:
        came = drive.event_ns(event) is not None
        finding.demand(came == is_wanted, f"{event} came" if came else f"{event} did not come")

    return check


def is_off(rig: Rig, _: Drive, finding: Finding) -> None:
    """Check that the motors have no power."""
    finding.demand(not rig.is_powered, "the motors still have power")


def power_was_cut(_: Rig, drive: Drive, finding: Finding) -> None:
    """Check that the motors had no power any more when sitting down was asked for."""
    finding.demand(drive.hal.was_off, "power was not cut, the robot was asked to sit")


def time_damping(log: Run, since_ns: int, finding: Finding) -> None:
    """Time the first command without stiffness that a log or an incident file holds."""
    soft = (log.commands.kp_nm_per_rad == 0.0).all(axis=1)
    first_ns = int(log.commands.robot_stamp_ns[np.argmax(soft)]) if soft.any() else 0
    finding.demand(first_ns >= since_ns, "nothing was damped")
    finding.reaction_ms = max(0, first_ns - since_ns) / NS_PER_MS


def damped(_: Rig, drive: Drive, finding: Finding) -> None:
    """Time the first command without stiffness."""
    time_damping(drive.log, drive.happened_ns, finding)
