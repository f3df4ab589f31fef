"""Rows that no matrix lists: two faults at once, and faults while the policy is not yet, or no more, in control."""

from __future__ import annotations

from collections.abc import Callable

from proof.faults.rig import Rig
from proof.faults.rows import Finding, Row, happens, judge, reacted
from proof.faults.rows_state import drive_way

Named = tuple[str, dict[str, float | str]]


def both(*faults: Named, outcomes: tuple[str, ...], at_s: float = 0.8) -> Callable[[Rig], Finding]:
    """Some faults in one instant."""

    def attempt(rig: Rig) -> Finding:
        acts = [lambda name=name, parameters=parameters: rig.inject(name, **parameters) for name, parameters in faults]
        drive = rig.drive(happens(*acts), at_s=at_s)
        return reacted(drive, judge(drive, outcomes), drive_way(drive))

    return attempt


GAP: Named = ("state_gap", {})
STOLEN: Named = ("lease_stolen", {"owner": "tablet-7"})
NAN: Named = ("nan_sensor", {"signal": "position"})
ESTOP: Named = ("estop_pressed", {})
LOW: Named = ("low_battery", {"percent": 4.0})
FALL: Named = ("behavior_fault", {"cause": "fall"})
BACK: Named = ("clock_jump", {"jump_s": -1.0})

ROWS = (
    Row("stale and lease stolen at once", 100.0, both(GAP, STOLEN, outcomes=("state_stale", "lease_lost"))),
    Row("NaN and e-stop at once", 100.0, both(NAN, ESTOP, outcomes=("state_not_finite", "estopped"))),
    Row("battery low, then no states", 300.0, both(LOW, GAP, outcomes=("battery_low", "state_stale"))),
    Row(
        "clock back and behaviour fault at once", 100.0, both(BACK, FALL, outcomes=("behavior_fault", "state_rejected"))
    ),
    Row("lease stolen in the ramp", 100.0, both(STOLEN, outcomes=("lease_lost",), at_s=0.1)),
    Row("NaN in the ramp", 25.0, both(NAN, outcomes=("state_not_finite",), at_s=0.1)),
    Row("stale as joint control begins", 80.0, both(GAP, outcomes=("state_stale",), at_s=0.0)),
    Row("e-stop as joint control begins", 100.0, both(ESTOP, outcomes=("estopped",), at_s=0.0)),
)
