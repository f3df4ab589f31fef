"""A case as things that happen to a run at their instants of robot time."""

from __future__ import annotations

import signal
from collections.abc import Callable

from proof.bench_signals import raise_as_fault
from proof.faults.faulty_hal import FaultyHal
from proof.faults.rig import Rig
from proof.faults.search.case import Case, Fault
from proof.faults.search.signals import SLOW, SpoiltSignal


def play(rig: Rig, case: Case) -> tuple[Callable[[FaultyHal], None]]:
    """What :meth:`Rig.drive` calls when the case's phase begins."""

    def begin(hal: FaultyHal) -> None:
        for fault in case.faults:
            _plan(rig, hal, fault)

    return (begin,)


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
