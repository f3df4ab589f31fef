"""Lines over time or over a quantity: real, nominal and corrected traces; what an unknown effect leaves."""

from __future__ import annotations

from typing import Final

import numpy as np

from diagnosis.channels.channel_view import Array
from diagnosis.document import Dependence
from diagnosis.read.policy_ticks import policy_ticks
from spot_log.page.svg import disc, line, nice_ticks, svg, text, thinned
from spot_log.read.run import Run

WIDTH: Final = 1160
PANEL: Final = 190
LEFT: Final = 62
SPAN_S: Final = 2.0
MAX_POINTS: Final = 700
QUANTITY_UNITS: Final = {
    "position": "rad",
    "velocity": "rad/s",
    "torque": "N·m",
    "acceleration": "rad/s²",
    "torque rate": "N·m/s",
    "total power": "W",
    "time since start": "s",
    "time since set-point": "s",
    "torque history": "(N·m)²·s",
    "body speed": "m/s",
    "vertical velocity": "m/s",
    "turn rate": "rad/s",
    "roll rate": "rad/s",
    "pitch rate": "rad/s",
    "total torque": "N·m",
}
"""Of what an unexplained residual may depend on."""
LONGEST_SHIFT_S: Final = 0.5


def traces(real: Run, nominal: Run | None, corrected: Run | None, joint: int, from_s: float) -> str:
    """Load and velocity of one joint over two seconds.

    Args:
        real: A log.
        nominal: The nominal model's run of the same commands.
        corrected: The corrected model's.
        joint: Number of the joint.
        from_s: Time under the policy at which the picture begins.
    """
    runs = [("var(--nominal)", 1.6, nominal), ("var(--corrected)", 1.6, corrected), ("var(--real)", 2.0, real)]
    parts = []
    for row, (title, name) in enumerate((("load, N·m", "load_nm"), ("velocity, rad/s", "velocity_rad_s"))):
        drawn = []
        for colour, width, run in runs:
            if run is not None:
                shift = in_phase_s(real, run, joint, from_s)
                at, values = _part(run, name, joint, from_s + shift)
                drawn.append((colour, width, at - shift, values))
        drawn = [d for d in drawn if len(d[2])]
        if not drawn:
            return ""
        both = np.concatenate([d[3] for d in drawn])
        parts.append(_axes(row, title, float(both.min()), float(both.max()), from_s))
        low, high = _range(float(both.min()), float(both.max()))
        for colour, width, at, values in drawn:
            x = LEFT + (at - from_s) / SPAN_S * (WIDTH - LEFT - 12)
            y = _y(row, values, low, high)
            parts.append(line(list(zip(x.tolist(), y.tolist(), strict=True)), colour, width))
    parts.append(
        text(WIDTH / 2, 2 * (PANEL + 24) + 26, "time under the policy, s", size=12, anchor="middle", css="soft")
    )
    return svg(WIDTH, 2 * (PANEL + 24) + 34, parts, "Load and velocity: real, nominal and corrected")


def in_phase_s(real: Run, other: Run, joint: int, from_s: float) -> float:
    """Time by which the other run's steps come later than the real one's around the picture, s; positions correlate."""
    at, wanted = _part(real, "position_rad", joint, from_s)
    rows = policy_ticks(other)
    if len(at) < 2 or len(rows) == 0:
        return 0.0
    time_s = (other.states.robot_stamp_ns - other.ticks.robot_stamp_ns[rows[0]]) * 1e-9
    values = np.nan_to_num(other.states.position_rad[:, joint])
    shifts = np.arange(-LONGEST_SHIFT_S, LONGEST_SHIFT_S, 0.005)
    inside = [s for s in shifts if time_s[0] <= at[0] + s and at[-1] + s <= time_s[-1]] or [0.0]
    moved = np.stack([np.interp(at + s, time_s, values) for s in inside])
    moved -= moved.mean(axis=1, keepdims=True)
    fit = moved @ (wanted - wanted.mean()) / np.maximum(np.linalg.norm(moved, axis=1), 1e-9)
    return float(inside[int(np.argmax(fit))])


def _part(run: Run, name: str, joint: int, from_s: float) -> tuple[Array, Array]:
    rows = policy_ticks(run)
    if len(rows) == 0:
        return np.zeros(0), np.zeros(0)
    time_s = (run.states.robot_stamp_ns - run.ticks.robot_stamp_ns[rows[0]]) * 1e-9
    part = np.flatnonzero((time_s >= from_s) & (time_s < from_s + SPAN_S))
    part = part[thinned(part, MAX_POINTS)]
    values = getattr(run.states, name)[part, joint]
    good = np.isfinite(values)
    return time_s[part][good], values[good]


def _range(low: float, high: float) -> tuple[float, float]:
    pad = 0.06 * max(high - low, 1e-9)
    return low - pad, high + pad


def _y(row: int, values: Array, low: float, high: float) -> Array:
    top = 10 + row * (PANEL + 24)
    return np.asarray(top + PANEL * (high - values) / (high - low))


def _axes(row: int, title: str, low: float, high: float, from_s: float) -> str:
    low, high = _range(low, high)
    top = 10 + row * (PANEL + 24)
    parts = [f'<rect class="grid" x="{LEFT}" y="{top}" width="{WIDTH - LEFT - 12}" height="{PANEL}"/>']
    for tick in nice_ticks(low, high, 4):
        y = float(_y(row, np.array(tick), low, high))
        parts.append(line([(LEFT, y), (WIDTH - 12, y)], "var(--line)", 1))
        parts.append(text(LEFT - 8, y + 4, f"{tick:g}", size=11, anchor="end", css="soft"))
    for tick in nice_ticks(from_s, from_s + SPAN_S, 8):
        x = LEFT + (tick - from_s) / SPAN_S * (WIDTH - LEFT - 12)
        parts.append(text(x, top + PANEL + 15, f"{tick:g}", size=11, anchor="middle", css="soft"))
    name = text(0, 0, title, size=12, anchor="middle")
    parts.append(f'<g transform="translate(14 {top + PANEL / 2:.0f}) rotate(-90)">{name}</g>')
    return "".join(parts)


def dependence(curve: Dependence, unit: str) -> str:
    """What is left over one quantity."""
    width, height, left = 540, 210, 60
    x, y = np.asarray(curve.at), np.asarray(curve.residual)
    if len(x) < 2:
        return ""
    low, high = _range(min(float(y.min()), 0.0), max(float(y.max()), 0.0))
    first, last = float(x.min()), float(x.max())

    def at(a: float, b: float) -> tuple[float, float]:
        return (
            left + (a - first) / max(last - first, 1e-12) * (width - left - 14),
            8 + (height - 50) * (high - b) / (high - low),
        )

    parts = []
    for tick in nice_ticks(low, high, 4):
        parts.append(line([at(first, tick), at(last, tick)], "var(--line)", 1))
        parts.append(text(left - 8, at(first, tick)[1] + 4, f"{tick:.3g}", size=11, anchor="end", css="soft"))
    parts += [
        text(at(tick, low)[0], height - 26, f"{tick:.3g}", size=11, anchor="middle", css="soft")
        for tick in nice_ticks(first, last, 5)
    ]
    points = [at(a, b) for a, b in zip(x.tolist(), y.tolist(), strict=True)]
    parts.append(line(points, "var(--unknown)", 2.5))
    parts += [
        disc(*p, 4, "var(--unknown)", f"{curve.quantity} {a:.3g}\nunexplained {b:.3g} {unit}")
        for p, a, b in zip(points, x.tolist(), y.tolist(), strict=True)
    ]
    name = f"{curve.quantity}, {QUANTITY_UNITS.get(curve.quantity.split(' of ')[0], '')}".rstrip(", ")
    parts.append(text(width / 2, height - 6, name, size=12, anchor="middle"))
    side = text(0, 0, f"unexplained, {unit}", size=12, anchor="middle")
    parts.append(f'<g transform="translate(12 {0.5 * (height - 42):.0f}) rotate(-90)">{side}</g>')
    return svg(width, height, parts, f"What is left over {name}")
