"""Rows of two or three faults at once: the graver one decides."""

from __future__ import annotations

from proof.faults.rows import Row
from proof.faults.rows_phases import ESTOP, GAP, LOW, NAN, STOLEN, Named, together

DROPS: Named = ("command_drops", {"probability": 0.5})
FALL: Named = ("behavior_fault", {"cause": "fall"})
FROZEN: Named = ("frozen_sensors", {})
BACK: Named = ("clock_jump", {"jump_s": -1.0})
DAMPED = ("state_stale", "state_not_finite", "clock_jumped", "state_rejected", "command_unconfirmed", "state_frozen")
WALKING_S = 0.8

ROWS = (
    Row(
        "stale and lease stolen at once",
        100.0,
        together(GAP, STOLEN, outcomes=("state_stale", "lease_lost"), at_s=WALKING_S),
    ),
    Row(
        "NaN and e-stop at once", 100.0, together(NAN, ESTOP, outcomes=("state_not_finite", "estopped"), at_s=WALKING_S)
    ),
    Row(
        "battery low, then no states",
        300.0,
        together(LOW, GAP, outcomes=("battery_low", "state_stale"), at_s=WALKING_S),
    ),
    Row(
        "clock back and behaviour fault at once",
        100.0,
        together(BACK, FALL, outcomes=("behavior_fault", "state_rejected"), at_s=WALKING_S),
    ),
    Row("commands lost and stale in the ramp", 100.0, together(DROPS, GAP, outcomes=DAMPED, at_s=0.1)),
    Row(
        "frozen, commands lost and lease stolen",
        100.0,
        together(FROZEN, DROPS, STOLEN, outcomes=("lease_lost", "state_frozen"), at_s=0.8),
    ),
    Row(
        "NaN, behaviour fault and low battery",
        100.0,
        together(NAN, FALL, LOW, outcomes=("state_not_finite", "behavior_fault"), at_s=0.8),
    ),
)
