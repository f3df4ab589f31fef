"""The figures of the report: gaps before and after, by joint and by regime.

Colours reach to the largest gap of their figure: in times what repeats or noise explain, or without these in its unit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from diagnosis.decision_constants import SIGNIFICANT
from diagnosis.document import Consequences, GapCell
from diagnosis.report.words import number
from spot_log.page.sections import Bar, Bars, Cell, Map

COLOURS: Final = ("var(--nominal)", "var(--corrected)", "var(--floor)")
"""Before, after, and what repeats or noise explain."""
LEAST_TOP: Final = 4.0
"""The darkest colour is of so many times what repeats or noise explain, or more: a robot without a gap stays pale."""
SIGNALS: Final = ("load error", "load", "torque error of swinging legs", "velocity", "position")
REGIMES: Final = (
    *("all", "motoring", "motoring, high speed", "motoring, high torque"),
    *("braking", "braking, high speed", "braking, high torque"),
    *("low torque", "middle torque", "high torque", "low speed", "middle speed", "high speed"),
    *("velocity reversal", "stance", "swing", "low total power", "high total power"),
    *("first third of time", "last third of time"),
)


def gap_bars(consequences: Consequences) -> Bars:
    """Before, after and what repeats or noise explain of each gap, each gap on its own scale."""
    groups = []
    for g in consequences.gaps:
        values = (g.before, g.after, g.floor)
        top = max(*values, 1e-12)
        told = [(value / top, colour, number(value)) for value, colour in zip(values, COLOURS, strict=True)]
        groups.append((g.gap, g.unit, [Bar(*bar, f"{g.gap}: {bar[2]} {g.unit}") for bar in told]))
    return Bars(groups, "Three gaps, before and after")


def gap_maps(cells: Sequence[GapCell], joints: Sequence[str]) -> list[Map]:
    """A map a signal: regimes down, joints across; hovering tells the figures."""
    return [_gap_map(signal, cells, joints) for signal in SIGNALS if any(c.signal == signal for c in cells)]


def _gap_map(signal: str, cells: Sequence[GapCell], joints: Sequence[str]) -> Map:
    known, cells = {c.regime for c in cells}, [c for c in cells if c.signal == signal]
    regimes = [r for r in REGIMES if r in known] + sorted(known - set(REGIMES))
    drawn = {(c.regime, c.joint): coloured(c, cells) for c in cells}
    rows = [(regime, [drawn.get((regime, joint), Cell(None)) for joint in joints]) for regime in regimes]
    return Map(joints, rows, f"Gap by signal, regime and joint: {signal}", signal, scale(cells))


def coloured(cell: GapCell, cells: Sequence[GapCell]) -> Cell:
    """A cell among those of its figure; a dot marks what is not due to chance."""
    is_sure = cell.p_value is not None and cell.p_value <= SIGNIFICANT
    return Cell(share_of(cell, top_of(cells)), cell_tip(cell), "•" if is_sure else "")


def top_of(cells: Sequence[GapCell]) -> float:
    """What the darkest colour stands for."""
    if has_floor(cells):
        return max(LEAST_TOP, *(c.ratio or 0.0 for c in cells))
    return max(c.gap for c in cells) or 1.0


def share_of(cell: GapCell, top: float) -> float:
    """Place on the scale of colours, 0 to 1."""
    return cell.gap / top if cell.ratio is None else max(cell.ratio - 1.0, 0.0) / (top - 1.0)


def scale(cells: Sequence[GapCell]) -> tuple[str, ...]:
    """Words below the scale of colours."""
    top = top_of(cells)
    if has_floor(cells):
        return tuple(f"{x:.2g}×" for x in (1.0, 0.5 + 0.5 * top, top))
    return tuple(number(x, cells[0].unit) for x in (0.0, 0.5 * top, top))


def meaning(cells: Sequence[GapCell]) -> str:
    """What a colour stands for."""
    noise = "sensors' noise makes" if all(c.p_value is None for c in cells) else "two runs of the robot differ by"
    return f"in times what {noise}" if has_floor(cells) else f"in {cells[0].unit}"


def note(cells: Sequence[GapCell]) -> str:
    """How to read it."""
    chance = "No sequence was repeated, so it is not known how much of it is due to chance."
    if has_floor(cells):
        chance = f"A dot marks what is not due to chance (p ≤ {SIGNIFICANT}, corrected for the number of cells)."
    colour = meaning(cells) if has_floor(cells) else "each signal in its unit"
    return f"Colour: the nominal model's gap, {colour}. Load error: measured load less what the servo asks. {chance}"


def has_floor(cells: Sequence[GapCell]) -> bool:
    """Whether it is known what repeats or noise explain."""
    return any(c.ratio is not None for c in cells)


def cell_tip(cell: GapCell) -> str:
    """A cell in words."""
    lines = [f"{cell.signal} of {cell.joint}", cell.regime, f"gap {cell.gap:.3g} {cell.unit}"]
    if cell.ratio is not None:
        lines.append(f"{cell.ratio:.1f} times the {cell.floor:.3g} {cell.unit} that repeats or noise explain")
    if cell.p_value is not None:
        lines.append(f"p = {cell.p_value:.3f}, corrected for the number of cells")
    return "\n".join(lines)
