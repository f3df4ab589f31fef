"""Whether an imported recording is what its mapping says: units, orders, signs and stamps, held against each other.

A doubt is certain where no robot can have made such numbers, or where another reading fits and the given one does not.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_log.importing.mapping import SIGNALS, signals_of
from spot_log.importing.recording import UNITS, ForeignRecording
from spot_model.robot.facts import BREADTH_FIRST, JOINT_NAMES, POSITION_HIGH_RAD, POSITION_LOW_RAD, Array
from spot_model.robot.rotation import conjugate_wxyz, multiply_wxyz, rotate_inverse_wxyz, tilt_rad

STOP_MARGIN_RAD: Final = 0.1
"""Zero errors and give of the stops together."""
WHOLE_TURNS_RAD: Final = 4 * np.pi
RATES_HZ: Final = (5.0, 5000.0)
FITS, FOLLOWS, MOVES_RAD, MIN_ROWS = 0.15, 0.9, 0.02, 20
"""Relative error of a scale that fits; correlation of what moves together; the least spread of a joint that moves."""
AGREES, DISAGREES = 0.15, 0.3
"""Misfits of directions: 17° and 35° apart."""
STANDARD_GRAVITY_M_S2: Final = 9.80665
GRAVITY_M_S2: Final = (7.0, 12.5)


class Mismatch(NamedTuple):
    """What does not fit, in one sentence."""

    text: str
    is_certain: bool = False
    """Nothing else is possible."""


def doubts_of(recording: ForeignRecording) -> list[Mismatch]:
    """All doubts, the certain ones first. Raises BadInputError where a signal cannot be read at all."""
    signals = {name: recording.signal(name) for name in recording.mapping.signals}
    time_s = (recording.stamps_ns - recording.stamps_ns[0]) * 1e-9
    with np.errstate(all="ignore"):  # numbers beyond all sense compare as such
        found = [*_blanks(recording, signals), *_spacing(time_s), *_stops(recording, signals["position"])]
        found += [*_motion(recording, signals, time_s), *_turned(recording, signals, time_s)]
    return sorted(found, key=lambda doubt: not doubt.is_certain)


def _blanks(recording: ForeignRecording, signals: dict[str, Array]) -> Iterator[Mismatch]:
    for name, values in signals.items():
        rows = recording.rows_with(*signals_of(SIGNALS[name].record))
        blank = ~_whole(values) & rows
        if not np.isfinite(values).any():
            yield Mismatch(f"signal {name} has no number in any row", is_certain=True)
        elif blank.any():
            text = f"signal {name} is blank in {blank.sum()} of {rows.sum()} rows, first in row {int(blank.argmax())}"
            yield Mismatch(f"{text}; resample the signals to the same stamps")


def _spacing(time_s: Array) -> Iterator[Mismatch]:
    steps_s = np.diff(time_s)
    usual_s = float(np.median(steps_s)) if len(steps_s) else 1 / RATES_HZ[0]
    odd = (steps_s > 1.5 * usual_s) | (steps_s < 0.5 * usual_s)
    if not RATES_HZ[0] <= 1 / usual_s <= RATES_HZ[1]:
        yield Mismatch(f"the usual step of the time is {usual_s:g} s; check the unit of 'time'")
    if odd.sum() > 0.01 * len(odd):
        text = f"{odd.sum()} of {len(odd)} steps of the time are not the usual {usual_s:g} s"
        yield Mismatch(f"{text} (to {steps_s.max():g} s): rows are missing, or several recordings are mixed")


def _stops(recording: ForeignRecording, position: Array) -> Iterator[Mismatch]:
    stops = np.column_stack([POSITION_LOW_RAD - STOP_MARGIN_RAD, POSITION_HIGH_RAD + STOP_MARGIN_RAD])
    limits, turns = dict(zip(JOINT_NAMES, stops, strict=True)), np.array([-WHOLE_TURNS_RAD, WHOLE_TURNS_RAD])
    names = recording.mapping.joint_names
    limits |= dict.fromkeys(recording.mapping.continuous_joints, np.array([-np.inf, np.inf]))
    low, high = np.array([limits.get(name, turns) for name in names]).T
    ours = [i for i, name in enumerate(names) if name in JOINT_NAMES]

    def outside(values: Array) -> Array:
        return np.asarray(((values < low) | (values > high)).mean(axis=0))

    share = outside(position)
    if not share.any():
        return
    readings = {f"unit: {unit}": position * f for unit, f in _units(recording, "position")}
    if set(names) == set(JOINT_NAMES):
        source = position[:, [names.index(joint) for joint in recording.mapping.source_joints if joint in names]]
        order = f"source_joint_names: [{', '.join(BREADTH_FIRST)}]"
        readings[order] = source[:, [BREADTH_FIRST.index(name) for name in names]]
    fitting = [how for how, values in readings.items() if ours and outside(values).max() < 0.01]
    hint = f"it would fit with {' or '.join(fitting)}" if fitting else "check unit, order, sign and offset"
    j, k = int(share.argmax()), ours or [0]
    text = f"signal position: {names[j]} is beyond {'its stops' if ours else 'two turns'} in {share[j]:.0%} of the rows"
    told = f"{np.nanmin(position[:, j]):.2f} to {np.nanmax(position[:, j]):.2f} rad, not {low[j]:.2f} to {high[j]:.2f}"
    yield Mismatch(f"{text} ({told}); {hint}", bool(ours) and share[k].max() > 0.05)


def _units(recording: ForeignRecording, name: str) -> list[tuple[str, float]]:
    """Units that the signal may have instead of its own, with the factor from what was read."""
    given = recording.mapping.signals.get(name, recording.mapping.time).unit
    units = UNITS[SIGNALS[name].quantity if name in SIGNALS else name]
    declared = units.get(given or "", 1.0)
    return [(other, factor / declared) for other, factor in units.items() if factor != declared]


def _motion(recording: ForeignRecording, signals: dict[str, Array], time_s: Array) -> Iterator[Mismatch]:
    """Velocity and set-points against positions, torque against the servo's law.

    Torque = stiffness × (set-point − position) + damping × (its speed − speed) + feedforward.
    """
    position, velocity, wanted = (signals.get(name) for name in ("position", "velocity", "setpoint_position"))
    assert position is not None  # noqa: S101 - a mapping without it is refused
    if velocity is not None:
        rows = _whole(position, velocity)
        # Over some 20 ms: the noise and the resolution of a position would hide its change from row to row.
        turn, stamps, k = position[rows], time_s[rows][:, None], _stride(time_s[rows], 0.02)
        covered = np.cumsum(np.diff(stamps, axis=0) * _between(velocity[rows]), axis=0)
        rate, mean = ((part[k:] - part[:-k]) / (stamps[1 + k :] - stamps[1:-k]) for part in (turn[1:], covered))
        yield from _held(recording, "velocity", "the change of position", rate, mean, 1.25)
    if wanted is not None:
        yield from _held(recording, "setpoint_position", "position", position, wanted, 3.0, must_follow=False)
    if wanted is not None and {"load", "kp"} <= signals.keys():
        zero = np.zeros_like(position)
        law = signals["kp"] * (wanted - position) + signals.get("feedforward", zero)
        if velocity is not None:
            law += signals.get("kd", zero) * (signals.get("setpoint_velocity", zero) - velocity)
        yield from _held(recording, "load", "the servo's law", law, signals["load"], 3.0)


def _stride(time_s: Array, span_s: float) -> int:
    return max(1, round(span_s / float(np.median(np.diff(time_s))))) if len(time_s) > 1 else 1


def _between(values: Array) -> Array:
    return (values[1:] + values[:-1]) / 2


def _whole(*arrays: Array) -> NDArray[np.bool_]:
    """Rows in which nothing is blank."""
    return np.asarray(np.logical_and.reduce([np.isfinite(values).all(axis=1) for values in arrays]))


def _held(
    recording: ForeignRecording,
    name: str,
    of: str,
    wanted: Array,
    given: Array,
    loose: float,
    *,
    must_follow: bool = True,
) -> Iterator[Mismatch]:
    """Hold a signal, shape (n, J), against what must be proportional to it, with a factor of 1/loose to loose."""
    rows, position = _whole(wanted, given), recording.signal("position")
    if rows.sum() < MIN_ROWS:
        return
    wanted, given = wanted[rows], given[rows]
    spread = [values.std(axis=0) for values in (wanted, given)]
    # A joint whose unit is in doubt may seem to move less.
    least = MOVES_RAD * min(1.0, UNITS["angle"].get(recording.mapping.signals["position"].unit or "", 1.0))
    moves = position[_whole(position)].std(axis=0) > least
    for values, size in zip((wanted, given), spread, strict=True):
        moves &= size > 1e-6 * np.abs(values).max()
    if not moves.any():
        return
    names = [joint for joint, is_moving in zip(recording.mapping.joint_names, moves, strict=True) if is_moving]
    alike = np.corrcoef(wanted[:, moves], given[:, moves], rowvar=False)[: len(names), len(names) :]
    own, best, most = np.diag(alike), np.abs(alike).argmax(axis=1), np.abs(alike).max(axis=1)
    foreign = (own**2 < 0.95) & (1 - most**2 < 0.25 * (1 - own**2)) & (most > FOLLOWS)
    if foreign.any():
        pairs = ", ".join(f"{names[j]} by {names[best[j]]}" for j in np.flatnonzero(foreign)[:4])
        text = f"signal {name} is in another joint order than {of}: {pairs} is what follows"
        yield Mismatch(f"{text}; name columns, or give 'source_joint_names'", sorted(best) == list(range(len(best))))
        return
    turned, lost = (", ".join(names[j] for j in np.flatnonzero(some)) for some in (own < -FOLLOWS, np.abs(own) < 0.5))
    if turned:
        yield Mismatch(
            f"signal {name} has the opposite sign of {of} in {turned}; 'scale: -1' turns it", is_certain=True
        )
    if lost and must_follow:
        yield Mismatch(f"signal {name} does not follow {of} in {lost}; check order, unit and stamps")
    factors = (own * spread[0][moves] / spread[1][moves])[own > FOLLOWS]
    if len(factors) and not 1 / loose <= (factor := float(np.median(factors))) <= loose:
        readings = [
            f"{signal} in {unit}"
            for signal in ([name, "time", "position"] if name == "velocity" else [name])
            for unit, f in _units(recording, signal)
            if abs((f * factor if signal == "position" else f / factor) - 1) < FITS
        ]
        hint = f"it would fit with {' or '.join(readings)}" if readings else "check 'unit', 'scale' and the time"
        yield Mismatch(f"signal {name} is {1 / factor:.3g} of {of}; {hint}", bool(readings))


def _turned(recording: ForeignRecording, signals: dict[str, Array], time_s: Array) -> Iterator[Mismatch]:
    """The orientation against gravity and turn rate, its other readings beside it."""
    if "odom_from_body" not in signals:
        return
    k = _stride(time_s, 0.05)
    signals, time_s = {name: values[::k] for name, values in signals.items()}, time_s[::k]
    given = signals["odom_from_body"]
    other = "xyzw" if recording.mapping.signals["odom_from_body"].order == "wxyz" else "wxyz"
    swapped = given[:, [3, 0, 1, 2] if other == "xyzw" else [1, 2, 3, 0]]
    evidence = _misfits(given, signals, time_s)
    then = {f"'order: {other}'": swapped, "its inverse": np.asarray(conjugate_wxyz(given))}
    for what in (what for what, misfit in evidence.items() if misfit > DISAGREES):
        size, how = min((_misfits(turn, signals, time_s)[what], how) for how, turn in then.items())
        hint = f"{how} would fit" if size < AGREES else "check order, frames, axes and units of both"
        yield Mismatch(f"signal odom_from_body does not agree with {what}; {hint}", size < AGREES)
        return
    rows = _whole(given)
    if not rows.any():
        return
    (tilt, face), (other_tilt, other_face) = (
        (np.median(tilt_rad(turn[rows])), np.median(np.abs(turn[rows, 0]))) for turn in (given, swapped)
    )
    # A body on its side or back for most of the time, or one that faces backwards where the other order faces ahead.
    if (tilt > 0.8 and face < 0.4) or (not evidence and other_tilt < 0.1 and other_face > 0.9):
        yield Mismatch(f"by signal odom_from_body the body lies or faces backwards; by 'order: {other}' it stands")


def _misfits(turn: Array, signals: dict[str, Array], time_s: Array) -> dict[str, float]:
    """How far an orientation is from each signal that tells it: 0 agrees, 1 is opposite."""
    found = {}
    force = signals.get("acceleration_of_imu_in_link")
    if force is not None and GRAVITY_M_S2[0] < _size(force) < GRAVITY_M_S2[1]:
        felt = rotate_inverse_wxyz(turn, np.array([0.0, 0.0, STANDARD_GRAVITY_M_S2]))
        found["gravity in acceleration_of_imu_in_link"] = _misfit(felt, force)
    old, new = conjugate_wxyz(turn[:-1]), turn[1:]
    for name in ("angular_vel_of_body_in_odom", "angular_vel_of_body_in_body", "angular_vel_of_link_in_link"):
        if name in signals and _size(signals[name]) > 0.05:
            step = multiply_wxyz(new, old) if name.endswith("odom") else multiply_wxyz(old, new)
            rate = 2 * np.sign(step[:, :1]) * step[:, 1:] / np.diff(time_s)[:, None]
            found[name] = _misfit(rate, _between(signals[name]))
    return found


def _size(values: Array) -> float:
    """Root mean square length of the rows; 0 where there are too few to tell."""
    rows = values[_whole(values)]
    return float(np.sqrt((rows**2).sum(axis=1).mean())) if len(rows) >= MIN_ROWS else 0.0


def _misfit(one: Array, two: Array) -> float:
    """The size of the difference as a share of the sizes' sum."""
    rows = _whole(one, two)
    return _size((one - two)[rows]) / max(_size(one[rows]) + _size(two[rows]), 1e-9)
