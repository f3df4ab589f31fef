"""Whether a fault matters: by how far it moves its robot, or by what it costs, in the simulated truth."""

from __future__ import annotations

from typing import Final

from withheld.outcome import Consequences, Outcome
from withheld.plan import Fault

LARGE: Final = 2.0
"""A fault matters that moves the headline gap by at least this many times its floor."""
SPEED_M_S: Final = 0.1
"""And one that costs so much of the top or mean speed."""
POWER: Final = 0.05
"""And one that costs so large a share of the power more."""
FALL: Final = 1.0 / 15.0
"""And one by which so large a share of the runs more ends in a fall: one of fifteen."""


def is_costly(own: Consequences | None) -> bool:
    """Whether a fault costs speed, power, or a fall."""
    if own is None:
        return False
    lost = (own.top_speed.of, own.mean_speed.of)
    power = own.power.of
    return (
        any(change is not None and change <= -SPEED_M_S for change in lost)
        or (power is not None and power >= POWER * (own.power.before or 0.0))
        or (own.fall_share.of or 0.0) >= FALL
    )


def matters(o: Outcome, number: int) -> bool:
    """Whether one of a case's faults does."""
    moved = o.moved[number] if number < len(o.moved) else None
    own = o.consequences[number] if number < len(o.consequences) else None
    return (moved is not None and moved >= LARGE) or is_costly(own)


def does(o: Outcome, number: int) -> str:
    """What one of a case's faults does, in words."""
    moved = o.moved[number] if number < len(o.moved) else None
    own = o.consequences[number] if number < len(o.consequences) else None
    words = ["" if moved is None else f"moves the robot by {moved:.1f} floors"]
    if own is not None:
        units = (("top speed", own.top_speed, "m/s"), ("mean speed", own.mean_speed, "m/s"), ("power", own.power, "W"))
        words += [f"{name} {c.of:+.2g} {unit}" for name, c, unit in units if c.of is not None]
        words += [f"falls {100 * own.fall_share.of:+.0f} %"] if own.fall_share.of else []
    told = ", ".join(filter(None, words)) or "not measured"
    return f"{told}; {'matters' if matters(o, number) else 'does not matter'}"


def is_named_by_library(fault: Fault, o: Outcome) -> bool:
    """Whether the case's library holds an effect that is a right answer."""
    return bool(set(fault.names) - set(o.case.without))


def inside(o: Outcome) -> list[int]:
    """Numbers of the faults that the case's library could name."""
    return [i for i, f in enumerate(o.truth.faults) if is_named_by_library(f, o)]


def outside(o: Outcome) -> list[int]:
    """Numbers of those that it could not."""
    return [i for i, f in enumerate(o.truth.faults) if not is_named_by_library(f, o)]
