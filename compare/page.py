"""The comparison as one page that opens from disk, without a network, light or dark."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from compare.cause import Cause
from compare.differences import SIGNALS, TITLES, Differences
from compare.tracks import SLIP_S, STEP_S, Track
from spot_log.page.charts import liveliest, stance
from spot_log.page.render import rendered
from spot_log.page.sections import Beside, Cell, Chart, Fold, Head, Items, Legend, Map, Section, Series, Shade, Table
from spot_model.robot.facts import JOINT_NAMES, LEG_NAMES, Array

CLOSE: Final = 0.10
"""Distributions that differ by less than this share of their spread are called close."""
SPAN_S: Final = 3.0
COLOURS: Final = ("var(--real)", "var(--nominal)", "var(--corrected)", "var(--floor)")


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
    lively = liveliest(np.abs(tracks[0].velocity_rad_s).sum(axis=1), round(SPAN_S / STEP_S))
    about_map = (
        "Distance between the distributions of each signal (1-Wasserstein, which ignores phase), in percent of the "
        "signal's standard deviation in the first run."
    )
    about_velocity = f"The body's velocity.{' Shaded: where the diagnosis sees the cause at work.' if causes else ''}"
    about_joints = (
        f"Difference from {tracks[0].name} over time. A simulated run drifts out of phase, so it grows with time."
    )
    colours = _coloured(tracks)
    feet = [Section(t.name, "", stance(t.foot_contact[lively], LEG_NAMES, colour)) for colour, t in colours]
    parts = [
        _head(tracks, found, cause),
        Section("Velocity against command", about_velocity, _velocity(tracks, causes)),
        Section("Where they differ", about_map, [Section(d.name, "", joint_map(d)) for d in found]),
        _worst_joint(tracks, found, causes, lively),
        Section("Feet on the ground", f"The same {SPAN_S:g} s.", feet),
        Section("Every joint", about_joints, Beside(_all_joints(found, causes), 3)),
        Section("Figures", "", Fold("Distance by joint (in brackets: rms in step)", _figures(found))),
        Section("Notes", "", Items(notes)),
    ]
    return rendered(f"{tracks[0].name} beside {', '.join(t.name for t in tracks[1:])}", parts)


def difference_sentence(reference: Track, found: Differences) -> str:
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


def _head(tracks: Sequence[Track], found: Sequence[Differences], cause: str) -> Head:
    reference = tracks[0]
    close, apart = ([d.name for d in found if is_close(d) == wanted] for wanted in (True, False))
    lines = [difference_sentence(reference, d) for d in found] + ([f"The diagnosis: {cause}."] if cause else [])
    meta = f"{stretch(tracks)} The commands are the same. Simulated runs are in closed loop, with the policy that ran."
    badge, kind = ("Some close", "fair") if close and apart else ("Close", "good") if close else ("Apart", "bad")
    told = [f"{verb} {' and '.join(names)}" for verb, names in (("like", close), ("differently from", apart)) if names]
    return Head(badge, kind, f"{reference.name} moves {', and '.join(told)}", lines, meta)


def _coloured(tracks: Sequence[Track]) -> list[tuple[str, Track]]:
    return [(COLOURS[i % len(COLOURS)], t) for i, t in enumerate(tracks)]


def _velocity(tracks: Sequence[Track], causes: Sequence[Cause]) -> list[Legend | Chart]:
    charts = []
    for axis, title in enumerate(("forward, m/s", "left, m/s", "turning, rad/s")):
        chart = _over_time([(c, t.body_velocity[:, axis]) for c, t in _coloured(tracks)], title, 130, causes)
        asked = Series("var(--other)", chart.lines[0].x, tracks[0].velocity_command[:, axis], width=3)
        charts.append(chart._replace(lines=[asked, *chart.lines], least_span=0.2))
    names = [("var(--other)", "commanded"), *((colour, t.name) for colour, t in _coloured(tracks))]
    return [Legend(names), *charts]


def _worst_joint(
    tracks: Sequence[Track], found: Sequence[Differences], causes: Sequence[Cause], rows: slice
) -> Section:
    signal, joint, _ = max(found, key=lambda d: d.largest[2]).largest
    j, from_s = JOINT_NAMES.index(joint), rows.start * STEP_S
    shaded = [c for c in causes if c.end_s > from_s and c.start_s < rows.stop * STEP_S]
    charts = []
    for name in dict.fromkeys((signal, "position_rad", "load_nm")):
        lines = [(colour, getattr(t, name)[rows, j]) for colour, t in _coloured(tracks)]
        charts.append(_over_time(lines, _title(name), 150, shaded, from_s))
    about = f"{joint}, in the {SPAN_S:g} s in which the joints move most. The gaits drift out of phase."
    key = Legend((colour, t.name) for colour, t in _coloured(tracks))
    return Section("The joint that differs most", about, [key, *charts])


def _all_joints(found: Sequence[Differences], causes: Sequence[Cause]) -> list[Fold]:
    def chart(name: str, j: int) -> Chart:
        lines = [(COLOURS[(i + 1) % len(COLOURS)], d.signals[name].over_time[:, j]) for i, d in enumerate(found)]
        return _over_time(lines, _title(name), 110, causes)

    return [Fold(joint, [chart("position_rad", j), chart("load_nm", j)]) for j, joint in enumerate(JOINT_NAMES)]


def _title(name: str) -> str:
    return f"{TITLES[name]}, {SIGNALS[name]}"


def _figures(found: Sequence[Differences]) -> Table:
    """A row each joint, a column each signal of each other run."""
    head = ["joint", *(f"{d.name}: {_title(name)}" for d in found for name in SIGNALS)]
    signals = [d.signals[name] for d in found for name in SIGNALS]
    told = [
        [f"{d:.3g} ({rms:.3g})" if np.isfinite(d) else "–" for d, rms in zip(s.distance, s.rms, strict=True)]
        for s in signals
    ]
    return Table(head, list(zip(JOINT_NAMES, *told, strict=True)))


def joint_map(found: Differences) -> Map:
    """Joints against signals: distance of the distributions in shares of the reference's spread; darkest at 1."""
    rows = []
    for name, unit in SIGNALS.items():
        signal, cells = found.signals[name], []
        for j, joint in enumerate(JOINT_NAMES):
            percent, title = f"{100 * float(signal.share[j]):.0f}", f"{TITLES[name]}, {joint}"
            tip = (
                f"{title}\ndistance {signal.distance[j]:.3g} {unit}, {percent} % of the standard deviation\n"
                f"rms in step {signal.rms[j]:.3g} {unit}"
            )
            known = Cell(float(signal.share[j]), tip, percent)
            cells.append(known if np.isfinite(signal.distance[j]) else Cell(None, f"{title}: not in both", "–"))
        rows.append((TITLES[name], cells))
    return Map(JOINT_NAMES, rows, f"Differences of {found.name} by joint")


def _over_time(
    lines: Sequence[tuple[str, Array]], title: str, height: float, causes: Sequence[Cause], from_s: float = 0.0
) -> Chart:
    """Samples :data:`STEP_S` apart, each of shape (n,) and with a colour, on one axis of time."""
    series = [Series(colour, from_s + np.arange(len(v)) * STEP_S, v) for colour, v in lines]
    shades = [Shade(c.start_s, c.end_s, c.text) for c in causes]
    return Chart(series, title, x_unit=" s", height=height, shades=shades)
