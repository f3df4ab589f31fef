"""Whether an imported recording is what its mapping says: units, orders, signs and stamps, held against each other.

A doubt is certain where no robot can have made such numbers, or where another reading fits and the given one does not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_log.importing.mapping import PER_JOINT, record_of
from spot_log.importing.recording import UNITS, Recording
from spot_model.robot.facts import JOINT_NAMES, JOINT_TYPES, LEG_NAMES, POSITION_HIGH_RAD, POSITION_LOW_RAD
from spot_model.robot.rotation import conjugate_wxyz, multiply_wxyz, rotate_inverse_wxyz, rotate_wxyz, tilt_rad
from spot_model.robot.state import Array

STOP_MARGIN_RAD: Final = 0.1
"""Zero errors and give of the stops together."""
BY_TYPE: Final = tuple(f"{leg}_{kind}" for kind in JOINT_TYPES for leg in LEG_NAMES)
"""The joint order of most simulators."""
WHOLE_TURNS_RAD: Final = 4 * np.pi
RATES_HZ: Final = (5.0, 5000.0)
FITS, FOLLOWS, MOVES_RAD, MIN_ROWS = 0.15, 0.9, 0.02, 20
"""Relative error of a scale that fits; correlation of what moves together; the least spread of a joint that moves."""
AGREES, DISAGREES = 0.15, 0.3
"""Misfits of directions: 17° and 35° apart."""
STANDARD_GRAVITY_M_S2: Final = 9.80665
GRAVITY_M_S2: Final = (7.0, 12.5)


class Doubt(NamedTuple):
    """What does not fit, in one sentence."""

    text: str
    is_certain: bool = False
    """Nothing else is possible."""


def doubts_of(recording: Recording) -> list[Doubt]:
    """All doubts, the certain ones first. Raises BadInputError where a signal cannot be read at all."""
    signals = {name: recording.signal(name) for name in recording.mapping.signals}
    time_s = (recording.stamps_ns - recording.stamps_ns[0]) * 1e-9
    found = [*_blanks(recording, signals), *_spacing(time_s), *_stops(recording, signals["position"])]
    found += [*_motion(recording, signals, time_s), *_servo(recording, signals), *_turned(recording, signals, time_s)]
    return sorted(found, key=lambda doubt: not doubt.is_certain)


def _blanks(recording: Recording, signals: dict[str, Array]) -> Iterator[Doubt]:
    for name, values in signals.items():
        rows = recording.rows_with(*(other for other in signals if record_of(other) == record_of(name)))
        blank = ~np.isfinite(values).all(axis=1) & rows
        if not np.isfinite(values).any():
            yield Doubt(f"signal {name} has no number in any row", is_certain=True)
        elif blank.any():
            text = f"signal {name} is blank in {blank.sum()} of {rows.sum()} rows, first in row {int(blank.argmax())}"
            yield Doubt(f"{text}; resample the signals to the same stamps")


def _spacing(time_s: Array) -> Iterator[Doubt]:
    steps_s = np.diff(time_s)
    if not len(steps_s):
        return
    usual_s = float(np.median(steps_s))
    odd = (steps_s > 1.5 * usual_s) | (steps_s < 0.5 * usual_s)
    if not RATES_HZ[0] <= 1 / usual_s <= RATES_HZ[1]:
        yield Doubt(f"the usual step of the time is {usual_s:g} s; check the unit of 'time'")
    if odd.mean() > 0.01:
        text = f"{odd.sum()} of {len(odd)} steps of the time are not the usual {usual_s:g} s"
        yield Doubt(f"{text} (to {steps_s.max():g} s): rows are missing, or several recordings are mixed")


def _stops(recording: Recording, position: Array) -> Iterator[Doubt]:
    names = recording.mapping.joint_names
    columns = [i for i, name in enumerate(names) if name in JOINT_NAMES]
    if not columns:
        turning = np.nanmax(np.abs(position), initial=0.0, where=np.isfinite(position), axis=0) > WHOLE_TURNS_RAD
        if turning.any():
            text = f"joint {names[int(turning.argmax())]} goes beyond two whole turns"
            yield Doubt(f"{text} (signal position); check the unit")
        return
    given = position[:, columns]
    rows = [JOINT_NAMES.index(names[i]) for i in columns]
    low, high = POSITION_LOW_RAD[rows] - STOP_MARGIN_RAD, POSITION_HIGH_RAD[rows] + STOP_MARGIN_RAD

    def outside(values: Array) -> Array:
        return np.asarray(((values < low) | (values > high)).mean(axis=0))

    share = outside(given)
    if not share.any():
        return
    joint = int(share.argmax())
    readings = {f"unit: {unit}": given * f for unit, f in _scales(recording, "position", "angle")}
    if set(names) == set(JOINT_NAMES):
        # What stands in the columns of the given order, read as that of most simulators.
        source = position[:, [names.index(j) for j in recording.mapping.source_joints]]
        readings["source_joint_names by type of joint (" + ", ".join(BY_TYPE[:5]) + ", …)"] = source[
            :, [BY_TYPE.index(names[i]) for i in columns]
        ]
    fitting = [how for how, values in readings.items() if outside(values).max() < 0.01]
    hint = f"it would fit with {' or '.join(fitting)}" if fitting else "check unit, order, sign and offset"
    text = f"signal position: {names[columns[joint]]} is beyond its stops in {share[joint]:.0%} of the rows"
    bounds = f"{given[:, joint].min():.2f} to {given[:, joint].max():.2f} rad"
    yield Doubt(f"{text} ({bounds}; they are {low[joint]:.2f} to {high[joint]:.2f} rad); {hint}", share.max() > 0.05)


def _scales(recording: Recording, name: str, kind: str) -> list[tuple[str, float]]:
    """Units that the signal may have instead of its own, with the factor from what was read."""
    unit = recording.mapping.time.unit if name == "time" else recording.mapping.signals[name].unit
    declared = UNITS[kind].get(unit or "", 1.0)
    return [(other, factor / declared) for other, factor in UNITS[kind].items() if factor != declared]


def _motion(recording: Recording, signals: dict[str, Array], time_s: Array) -> Iterator[Doubt]:
    position = signals["position"]
    if "velocity" in signals:
        rows = _whole(position, signals["velocity"])
        # Over some 20 ms: the noise and the resolution of a position would hide its change from row to row.
        turn, stamps, k = position[rows], time_s[rows][:, None], _stride(time_s[rows], 0.02)
        covered = np.diff(stamps, axis=0) * _between(signals["velocity"][rows])
        covered = np.concatenate([np.zeros_like(turn[:1]), np.cumsum(covered, axis=0)])
        rate, mean = ((part[k:] - part[:-k]) / (stamps[k:] - stamps[:-k]) for part in (turn, covered))
        yield from _held(recording, "velocity", "the change of position", rate, mean, 1.25)
    if "setpoint_position" in signals:
        rows, name = _whole(position, signals["setpoint_position"]), "setpoint_position"
        yield from _held(recording, name, "position", position[rows], signals[name][rows], 3.0, must_follow=False)


def _stride(time_s: Array, span_s: float) -> int:
    return max(1, round(span_s / float(np.median(np.diff(time_s))))) if len(time_s) > 1 else 1


def _between(values: Array) -> Array:
    return (values[1:] + values[:-1]) / 2


def _servo(recording: Recording, signals: dict[str, Array]) -> Iterator[Doubt]:
    """Torque = stiffness × (set-point − position) + damping × (its speed − speed) + feedforward."""
    if not {"load", "setpoint_position", "kp"} <= set(signals):
        return
    zero = np.zeros_like(signals["position"])
    law = signals["kp"] * (signals["setpoint_position"] - signals["position"]) + signals.get("feedforward", zero)
    if "velocity" in signals:
        law += signals.get("kd", zero) * (signals.get("setpoint_velocity", zero) - signals["velocity"])
    rows = _whole(law, signals["load"])
    yield from _held(recording, "load", "the servo's law", law[rows], signals["load"][rows], 3.0)


def _whole(*arrays: Array) -> NDArray[np.bool_]:
    """Rows in which nothing is blank."""
    return np.asarray(np.logical_and.reduce([np.isfinite(values).all(axis=1) for values in arrays]))


def _held(
    recording: Recording, name: str, of: str, wanted: Array, given: Array, loose: float, *, must_follow: bool = True
) -> Iterator[Doubt]:
    """Hold a signal, shape (n, J), against what must be proportional to it, with a factor of 1/loose to loose."""
    if len(wanted) < MIN_ROWS:
        return
    spread, other = wanted.std(axis=0), given.std(axis=0)
    position = recording.signal("position")
    # A joint whose unit is in doubt may seem to move less.
    least = MOVES_RAD * min(1.0, UNITS["angle"].get(recording.mapping.signals["position"].unit or "", 1.0))
    moves = (spread > 1e-6 * np.abs(wanted).max()) & (other > 1e-6 * np.abs(given).max())
    columns = np.flatnonzero(moves & (position[_whole(position)].std(axis=0) > least))
    if not len(columns):
        return
    names = [recording.mapping.joint_names[i] for i in columns]
    scaled = [(v[:, columns] - v[:, columns].mean(axis=0)) / v[:, columns].std(axis=0) for v in (wanted, given)]
    alike = scaled[0].T @ scaled[1] / len(wanted)
    own, best = np.diag(alike), np.abs(alike).argmax(axis=1)
    left, left_best = 1 - own**2, 1 - np.abs(alike).max(axis=1) ** 2
    foreign = (left > 0.05) & (left_best < 0.25 * left) & (left_best < 1 - FOLLOWS**2)
    if foreign.any():
        pairs = ", ".join(f"{names[j]} by {names[best[j]]}" for j in np.flatnonzero(foreign)[:4])
        text = f"signal {name} is in another joint order than {of}: {pairs} is what follows"
        yield Doubt(f"{text}; name columns, or give 'source_joint_names'", sorted(best) == list(range(len(best))))
        return
    turned = own < -FOLLOWS
    if turned.any():
        yield Doubt(
            f"signal {name} has the opposite sign of {of} in {_some(names, turned)}; 'scale: -1' turns it", True
        )
    lost = np.abs(own) < 0.5
    if lost.any() and must_follow:
        yield Doubt(f"signal {name} does not follow {of} in {_some(names, lost)}; check order, unit and stamps")
    factors = (own * spread[columns] / other[columns])[own > FOLLOWS]
    if len(factors) and not 1 / loose <= (factor := float(np.median(factors))) <= loose:
        readings = [f"{name} in {unit}" for unit, f in _scales(recording, name, PER_JOINT[name]) if _near(f, factor)]
        if name == "velocity":
            readings += [f"time in {unit}" for unit, f in _scales(recording, "time", "time") if _near(f, factor)]
            readings += [f"position in {u}" for u, f in _scales(recording, "position", "angle") if _near(1 / f, factor)]
        hint = f"it would fit with {' or '.join(readings)}" if readings else "check 'unit', 'scale' and the time"
        yield Doubt(f"signal {name} is {1 / factor:.3g} of {of}; {hint}", bool(readings))


def _near(factor: float, found: float) -> bool:
    return abs(factor / found - 1) < FITS


def _some(names: list[str], chosen: NDArray[np.bool_]) -> str:
    return ", ".join(name for name, is_chosen in zip(names, chosen, strict=True) if is_chosen)


def _turned(recording: Recording, signals: dict[str, Array], time_s: Array) -> Iterator[Doubt]:
    """The orientation against gravity, turn rate and travel, its other readings beside it."""
    if "odom_from_body" not in signals:
        return
    k = _stride(time_s, 0.05)
    signals, time_s = {name: values[::k] for name, values in signals.items()}, time_s[::k]
    given = signals["odom_from_body"]
    other = "xyzw" if recording.mapping.signals["odom_from_body"].order == "wxyz" else "wxyz"
    swapped = given[:, [3, 0, 1, 2] if other == "xyzw" else [1, 2, 3, 0]]
    readings = {f"'order: {other}'": swapped, "its inverse": np.asarray(conjugate_wxyz(given))}
    evidence = list(_evidence(signals, time_s))
    for what, misfit in evidence:
        then = {how: misfit(values) for how, values in readings.items()}
        if misfit(given) > DISAGREES:
            how = min(then, key=lambda reading: then[reading])
            hint = f"{how} would fit" if then[how] < AGREES else "check order, frames, axes and units of both"
            yield Doubt(f"signal odom_from_body does not agree with {what}; {hint}", then[how] < AGREES)
            return
    rows = _whole(given)
    lies, faces = (
        [float(np.median(part)) for part in (tilt_rad(q[rows]), np.abs(q[rows][:, 0]))] for q in (given, swapped)
    )
    if rows.any() and ((lies[0] > 0.8 and faces[0] < 0.4) or (not evidence and lies[1] < 0.1 and faces[1] > 0.9)):
        yield Doubt(f"by signal odom_from_body the body lies or faces backwards; by 'order: {other}' it stands")


def _evidence(signals: dict[str, Array], time_s: Array) -> Iterator[tuple[str, Callable[[Array], float]]]:
    """What else tells the orientation, and a function that tells how far one is from it: 0 agrees, 1 is opposite."""

    def up(turn: Array) -> Array:
        return np.asarray(rotate_inverse_wxyz(turn, np.broadcast_to([0.0, 0.0, 1.0], turn[:, 1:].shape)))

    def rate(turn: Array, *, in_odom: bool = False) -> Array:
        old, new = turn[:-1], turn[1:]
        step = multiply_wxyz(new, conjugate_wxyz(old)) if in_odom else multiply_wxyz(conjugate_wxyz(old), new)
        return np.asarray(2 * np.sign(step[:, :1]) * step[:, 1:] / np.diff(time_s)[:, None])

    force = signals.get("acceleration_of_imu_in_link")
    if force is not None and GRAVITY_M_S2[0] < _size(force) < GRAVITY_M_S2[1]:
        yield "gravity in acceleration_of_imu_in_link", lambda turn: _misfit(up(turn), force / STANDARD_GRAVITY_M_S2)
    for name in ("angular_vel_of_body_in_odom", "angular_vel_of_body_in_body", "angular_vel_of_link_in_link"):
        if name in signals and _size(signals[name]) > 0.05:
            measured, in_odom = _between(signals[name]), name.endswith("odom")
            yield name, partial(lambda turn, m, o: _misfit(rate(turn, in_odom=o), m), m=measured, o=in_odom)
    place, speed = signals.get("position_of_body_in_odom"), signals.get("linear_vel_of_body_in_body")
    if place is not None and speed is not None and _size(speed) > 0.1:
        moved = np.diff(place, axis=0) / np.diff(time_s)[:, None]
        yield "the travel", lambda turn: _misfit(_between(np.asarray(rotate_wxyz(turn, speed))), moved)


def _size(values: Array) -> float:
    """Root mean square length of the rows; 0 where there are too few to tell."""
    rows = values[_whole(values)]
    return float(np.sqrt((rows**2).sum(axis=1).mean())) if len(rows) >= MIN_ROWS else 0.0


def _misfit(one: Array, two: Array) -> float:
    """The size of the difference as a share of the sizes' sum."""
    rows = _whole(one, two)
    return _size((one - two)[rows]) / max(_size(one[rows]) + _size(two[rows]), 1e-9)
