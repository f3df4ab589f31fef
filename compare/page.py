"""The comparison as one page that opens from disk, without a network, light or dark."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from compare.cause import Cause
from compare.differences import SIGNALS, TITLES, Differences, SignalDifference
from compare.tracks import SLIP_S, STEP_S, Array, Track
from spot_log.page.chart import Series, Shade, chart
from spot_log.page.look import boxed, folded, framed, headed, listed, table
from spot_log.page.rows import Cell, heat_map, stance
from spot_log.page.svg import esc, legend, liveliest
from spot_model.robot.facts import JOINT_NAMES, LEG_NAMES

CLOSE: Final = 0.10
"""Distributions that differ by less than this share of their spread are called close."""
SPAN_S: Final = 3.0
COLOURS: Final = ("var(--real)", "var(--nominal)", "var(--corrected)", "var(--floor)")
_MORE: Final = """
.joints { display: grid; grid-template-columns: repeat(3, 1fr); gap: 2px 16px; }
.joints details[open] { grid-column: 1 / -1; }
@media print { section:has(> .joints):not(:has(details[open])) { display: none; } }
"""


def comparison_page(
    tracks: Sequence[Track], found: Sequence[Differences], causes: Sequence[Cause], cause: str, notes: Sequence[str]
) -> str:
    """The page as text.

    Args:
        tracks: Aligned runs, the reference first.
        found: Differences of each other run from the reference.
        causes: Stretches of the reference that a diagnosis names.
        cause: What the diagnosis found, in words; empty for none.
        notes: Sentences for the end of the page.
    """
    body = [
        _head(tracks, found, cause),
        _velocity(tracks, causes),
        _by_joint(found),
        _worst_joint(tracks, found, causes),
        _gait(tracks),
        _all_joints(tracks, found, causes),
        _figures(found),
    ]
    body.append(boxed("Notes", "", listed(notes)))
    return framed(f"{tracks[0].name} beside {', '.join(t.name for t in tracks[1:])}", body, _MORE)


def sentence(reference: Track, found: Differences) -> str:
    """What differs most, in one sentence, and whether that is close."""
    speeds = found.forward_speed_m_s
    told = ""
    if np.isfinite(speeds).all():
        told = f"{reference.name} moves at {speeds[0]:.2f} m/s, {found.name} at {speeds[1]:.2f} m/s. "
    if not found.is_known:
        return f"{told}{reference.name} and {found.name} have no joint signal in common."
    signal, joint, share = found.largest
    if share == 0.0:
        return told + "All joints move alike."
    distance = found.signals[signal].distance[JOINT_NAMES.index(joint)]
    bound = f"{'close, below' if is_close(found) else 'close would be below'} {100 * CLOSE:.0f} %"
    return told + (
        f"They differ most in the {TITLES[signal]} of {joint}: by {distance:.3g} {SIGNALS[signal]}, "
        f"{100 * share:.1f} % of its standard deviation ({bound})."
    )


def stretch(tracks: Sequence[Track]) -> str:
    """How much of each run is compared, in one sentence."""
    shared_s = len(tracks[0]) * STEP_S
    if all(track.whole_s < shared_s + SLIP_S and not track.fell for track in tracks):
        return f"Compared: all {shared_s:.1f} s of each run."
    parts = []
    for track in tracks:
        is_whole = track.whole_s < shared_s + SLIP_S
        fell = ", which falls" if track.fell else ""
        parts.append(f"{'all' if is_whole else f'{shared_s:.1f} of'} {track.whole_s:.1f} s of {track.name}{fell}")
    return f"Compared: {'; '.join(parts)}."


def is_close(found: Differences) -> bool:
    """Whether every signal of every joint has nearly the distribution that it has in the first run."""
    return found.is_known and found.largest[2] < CLOSE


def _head(tracks: Sequence[Track], found: Sequence[Differences], cause: str) -> str:
    reference = tracks[0]
    close, apart = ([d.name for d in found if is_close(d) == wanted] for wanted in (True, False))
    lines = [sentence(reference, d) for d in found] + ([f"The diagnosis: {cause}."] if cause else [])
    meta = f"{stretch(tracks)} The commands are the same. Simulated runs are in closed loop, with the policy that ran."
    badge, kind = ("Some close", "fair") if close and apart else ("Close", "good") if close else ("Apart", "bad")
    told = [f"{verb} {' and '.join(names)}" for verb, names in (("like", close), ("differently from", apart)) if names]
    return headed(badge, kind, f"{reference.name} moves {', and '.join(told)}", lines, meta)


def _key(tracks: Sequence[Track]) -> str:
    return legend((COLOURS[i % len(COLOURS)], t.name) for i, t in enumerate(tracks))


def _velocity(tracks: Sequence[Track], causes: Sequence[Cause]) -> str:
    figures = []
    for axis, title in enumerate(("forward, m/s", "left, m/s", "turning, rad/s")):
        lines = [("var(--other)", 3.0, tracks[0].velocity_command[:, axis])]
        lines += [(COLOURS[i % len(COLOURS)], 1.4, t.body_velocity[:, axis]) for i, t in enumerate(tracks)]
        figures.append(over_time(lines, title, height=130, causes=causes, least_span=0.2))
    key = legend([("var(--other)", "commanded"), *[(COLOURS[i % len(COLOURS)], t.name) for i, t in enumerate(tracks)]])
    shaded = " Shaded: where the diagnosis sees the cause at work." if causes else ""
    return boxed("Velocity against command", f"The body's velocity.{shaded}", key + "".join(figures))


def _by_joint(found: Sequence[Differences]) -> str:
    about = (
        "Distance between the distributions of each signal (1-Wasserstein, which ignores phase), in percent of the "
        "signal's standard deviation in the first run."
    )
    parts = [f"<h3>{esc(d.name)}</h3>{joint_map(d)}" for d in found]
    return boxed("Where they differ", about, "".join(parts))


def _worst_joint(tracks: Sequence[Track], found: Sequence[Differences], causes: Sequence[Cause]) -> str:
    signal, joint, _ = max(found, key=lambda d: d.largest[2]).largest
    rows = _shown(tracks[0])
    j, from_s = JOINT_NAMES.index(joint), rows.start * STEP_S
    names = dict.fromkeys((signal, "position_rad", "load_nm"))
    figures = []
    for name in names:
        lines = [(COLOURS[i % len(COLOURS)], 1.8, getattr(t, name)[rows, j]) for i, t in enumerate(tracks)]
        shaded = [c for c in causes if c.end_s > from_s and c.start_s < rows.stop * STEP_S]
        figures.append(over_time(lines, f"{TITLES[name]}, {SIGNALS[name]}", from_s=from_s, height=150, causes=shaded))
    about = f"{joint}, in the {SPAN_S:g} s in which the joints move most. The gaits drift out of phase."
    return boxed("The joint that differs most", about, _key(tracks) + "".join(figures))


def _gait(tracks: Sequence[Track]) -> str:
    rows = _shown(tracks[0])
    parts = []
    for i, track in enumerate(tracks):
        figure = stance(track.foot_contact[rows], LEG_NAMES, COLOURS[i % len(COLOURS)])
        if figure:
            parts.append(f"<h3>{esc(track.name)}</h3>{figure}")
    return boxed("Feet on the ground", f"The same {SPAN_S:g} s.", "".join(parts))


def _all_joints(tracks: Sequence[Track], found: Sequence[Differences], causes: Sequence[Cause]) -> str:
    parts = []
    for j, joint in enumerate(JOINT_NAMES):
        figures = []
        for name in ("position_rad", "load_nm"):
            lines = [
                (COLOURS[(i + 1) % len(COLOURS)], 1.2, d.signals[name].over_time[:, j]) for i, d in enumerate(found)
            ]
            title = f"{TITLES[name]}, {SIGNALS[name]}"
            figures.append(over_time(lines, title, height=110, causes=causes))
        parts.append(folded(joint, "".join(figures)))
    about = f"Difference from {tracks[0].name} over time. A simulated run drifts out of phase, so it grows with time."
    return boxed("Every joint", about, f"<div class='joints'>{''.join(parts)}</div>")


def _figures(found: Sequence[Differences]) -> str:
    rows = [
        (f"{d.name}: {TITLES[n]}, {unit}", *(_pair(d.signals[n], j) for j in range(len(JOINT_NAMES))))
        for d in found
        for n, unit in SIGNALS.items()
    ]
    shown = f"<div style='overflow-x:auto'>{table(('', *JOINT_NAMES), rows)}</div>"
    return boxed("Figures", "", folded("Distance by joint (in brackets: rms in step)", shown))


def _pair(signal: SignalDifference, joint: int) -> str:
    if not np.isfinite(signal.distance[joint]):
        return "–"
    return f"{signal.distance[joint]:.3g} ({signal.rms[joint]:.3g})"


def joint_map(found: Differences) -> str:
    """Joints against signals: distance of the distributions in shares of the reference's spread; darkest at 1."""
    rows = []
    for name, unit in SIGNALS.items():
        signal, cells = found.signals[name], []
        for j, joint in enumerate(JOINT_NAMES):
            share, title = float(signal.share[j]), f"{TITLES[name]}, {joint}"
            tip = (
                f"{title}\ndistance {signal.distance[j]:.3g} {unit}, {100 * share:.0f} % of the standard deviation\n"
                f"rms in step {signal.rms[j]:.3g} {unit}"
            )
            is_known = np.isfinite(signal.distance[j])
            cells.append(
                Cell(share, tip, f"{100 * share:.0f}") if is_known else Cell(None, f"{title}: not in both", "–")
            )
        rows.append((TITLES[name], cells))
    return heat_map(JOINT_NAMES, rows, f"Differences of {found.name} by joint")


def over_time(
    lines: Sequence[tuple[str, float, Array]],
    title: str,
    *,
    from_s: float = 0.0,
    height: float = 190,
    causes: Sequence[Cause] = (),
    least_span: float = 0.0,
) -> str:
    """Lines on one axis of time.

    Args:
        lines: Colour, width and samples :data:`STEP_S` apart, each of shape (n,).
        title: Of the vertical axis, with its unit.
        from_s: Time of the first sample.
        height: Of the plot.
        causes: Stretches that are shaded.
        least_span: What the vertical axis shows at least.
    """
    series = [Series(c, from_s + np.arange(len(v)) * STEP_S, v, width=w) for c, w, v in lines]
    end_s = from_s + max(len(v) for _, _, v in lines) * STEP_S
    shades = [Shade(max(c.start_s, from_s), min(c.end_s, end_s), c.text) for c in causes]
    return chart(series, title, x_unit=" s", height=height, shades=shades, least_span=least_span)


def _shown(track: Track) -> slice:
    """The stretch in which the joints move most."""
    return liveliest(np.abs(track.velocity_rad_s).sum(axis=1), round(SPAN_S / STEP_S))
