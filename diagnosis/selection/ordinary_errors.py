"""What a nominal model of ordinary quality is off by, a few per cent everywhere: columns that are always fitted beside.

Each is a unit of an effect of the library, with a normal prior of a published spread in place of free play: an armature
that is 4 g·m² off or a body that is half a kilogram off is no finding. An effect must explain what these cannot without
leaving their spreads, which are in :mod:`diagnosis.decision_constants`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from diagnosis.channels import Array, Channel, ChannelView, Flags, Ints, Shape
from diagnosis.channels.actuator import ActuatorSignals
from diagnosis.decision_constants import ERROR_SCALES, ErrorScale
from diagnosis.library import JointGroups, LibraryEffect, Location
from spot_model.effects.base import Effect, TorqueEffect
from spot_model.effects.friction import CoulombFriction
from trainer.signals.motor_torque import direction, nominal_torque_nm, presliding

BUILDS_UP_RAD: Final = 0.003
"""Over which the nominal model's dry friction usually builds up after a reversal."""
OWN_NUMBERS: Final = 0.05
"""Standard deviation of a nominal torque effect's own numbers, relative."""

UNLIKE_MOTION: Final = frozenset(
    {
        *("load_sensor_gain", "load_filter", "joint_compliance"),
        *("torque_gain", "thermal_derating", "torque_bandwidth", "torque_delay", "backlash"),
        *("torque_limit", "torque_speed_curve", "position_torque_limit", "power_limit", "bus_sag"),
    }
)
"""Effects that loads which are computed from the motion cannot show: no sensor made them, and they are the small rest
of a torque that goes into friction and rotors. What takes a share of the torque would shrink it toward that rest."""


@dataclass(frozen=True)
class ErrorKind:
    """Errors of one effect's kind: a column for each set of units and coefficient, coefficients fastest."""

    effect: LibraryEffect
    at: Shape
    first: int
    sets: tuple[Flags, ...]
    """Units of each set, shape (U,)."""
    chosen: Ints
    """Coefficients that have an error."""

    def columns(self, coefficient: int) -> Ints:
        """Columns of one of the chosen coefficients, by set."""
        return self.first + coefficient + len(self.chosen) * np.arange(len(self.sets))

    def coefficients(self, size: Array) -> Array:
        """Coefficients of each unit, shape (U, C), from the size of all columns, shape (Q,)."""
        out = np.zeros((len(self.sets[0]), len(self.effect.coefficients)))
        for k, coefficient in enumerate(self.chosen):
            out[:, coefficient] = np.sum(np.array(self.sets) * size[self.columns(k)][:, None], axis=0)
        return out


@dataclass(frozen=True)
class Ordinary:
    """The columns, Q in all, scaled so that a unit of each is its published spread."""

    x: tuple[Array, ...]
    """By block, shape (m, q)."""
    numbers: tuple[Ints, ...]
    """By block: which of the Q its columns are, shape (q,)."""
    names: tuple[str, ...]
    """Effect of each of the Q."""
    kinds: tuple[ErrorKind, ...]
    """Where each effect's errors stand among the Q."""
    scale: Array
    """Published spread of each of the Q, in the effect's own units. Shape (Q,)."""

    @property
    def size(self) -> int:
        """Q."""
        return len(self.names)


def ordinary(board: Any, library: Mapping[str, LibraryEffect], scales: Mapping[str, ErrorScale]) -> Ordinary:
    """Columns of the ordinary errors of a board, with their published ranges by effect.

    Effects that are left out of the library as causes belong in here too: nominal models err all the same.
    """
    parts: list[list[Array]] = [[] for _ in board.blocks]
    numbers: list[list[int]] = [[] for _ in board.blocks]
    names: list[str] = []
    kinds: list[ErrorKind] = []
    sizes: list[float] = []

    def add(name: str, size: float, by_block: Mapping[int, Array]) -> None:
        for number, x in by_block.items():
            if x.any():
                parts[number].append(x * size)
                numbers[number].append(len(names))
        names.append(name)
        sizes.append(size)

    for name, given in scales.items():
        effect = library.get(name)
        if effect is None or not effect.show(board.views):
            continue
        scale = np.array([given.scales.get(c.name, 0.0) for c in effect.coefficients])
        columns, chosen = board.columns(effect, given.at), np.flatnonzero(scale > 0.0)
        kinds.append(ErrorKind(effect, given.at, len(names), tuple(error_sets(board.robot, effect)), chosen))
        for members in kinds[-1].sets:
            summed = {
                number: x[:, members[units]].sum(axis=1)
                for number, (units, x) in enumerate(zip(columns.units, columns.x, strict=True))
                if members[units].any()
            }
            for k in chosen:
                size = scale[k] * (given.alike if members.sum() > 1 else 1.0)
                add(name, size, {number: x[:, k] for number, x in summed.items()})
    loads = [(n, b) for n, b in enumerate(board.blocks) if b.channel == Channel.SET_POINT_TO_LOAD]
    for own in _own_numbers(board, scales):
        for joint in range(board.robot.n_joints):
            if own[:, joint].any():
                add("nominal", 1.0, {n: b.cleaned(own[b.samples, joint]) for n, b in loads if b.row == joint})
    return Ordinary(
        tuple(
            np.stack(p, axis=1).astype(np.float64) if p else np.zeros((len(b.y), 0))
            for p, b in zip(parts, board.blocks, strict=True)
        ),
        tuple(np.array(n, dtype=np.intp) for n in numbers),
        tuple(names),
        tuple(kinds),
        np.array(sizes),
    )


def of_unknown_drive(view: ChannelView) -> dict[str, ErrorScale]:
    """Ordinary errors where loads are computed from the motion, and no nominal number of the drive is known.

    Friction, rotors or a constant may each take all that the drive gives.
    """
    s: ActuatorSignals = view.signals
    velocity, torque = s.finish(s.velocity_rad_s), s.finish(s.torque_nm)
    given = {
        "coulomb_friction": np.ones_like(velocity),
        "torque_offset": np.ones_like(velocity),
        "viscous_friction": velocity,
        "armature": s.finish_rate(s.inertial_velocity_rad_s),
    }
    scales = {name: scale for name, scale in ERROR_SCALES.items() if name not in UNLIKE_MOTION}
    for name, motion in given.items():
        size = float(np.linalg.norm(torque)) / max(float(np.linalg.norm(motion)), 1e-9)
        scales[name] = ErrorScale(dict.fromkeys(ERROR_SCALES[name].scales, size))
    return scales


def error_sets(robot: JointGroups, effect: LibraryEffect) -> list[Flags]:
    """Units, each by itself, and alike: those of a type and all, since a maker's figure is wrong for all of a kind."""
    n = len(robot.units(effect.location))
    sets: list[Flags] = list(np.eye(n, dtype=np.bool_))
    if n > 1:
        sets.append(np.ones(n, dtype=np.bool_))
    if effect.location is Location.JOINT:
        sets += list(robot.types().values())
    return sets


def _own_numbers(board: Any, scales: Mapping[str, ErrorScale]) -> list[Array]:
    """What the usual error of each number of the nominal torque effects changes in the load; each shape (n, J).

    Of effects that are ordinary errors themselves there are columns already; two for one number would share what
    changes, and show none of it. Dry friction, moreover, builds up over a distance that no model file holds.
    """
    view = board.views.get(Channel.SET_POINT_TO_LOAD)
    if view is None:
        return []
    s: ActuatorSignals = view.signals
    found = []
    for i, effect in enumerate(s.effects):
        if isinstance(effect, CoulombFriction) and not effect.is_null:
            late = direction(s.still_velocity_rad_s) - presliding(s.position_rad, s.stack.run, BUILDS_UP_RAD)
            found.append(s.finish(effect.level_nm * effect.mask * late))
        if not isinstance(effect, TorqueEffect) or effect.is_null or effect.name in scales:
            continue
        for p in effect.parameters():
            value = getattr(effect, p.name)
            if not np.all(np.isfinite(value)) or np.all(np.asarray(value) == p.null):
                continue
            moved = replace(effect, **{p.name: value * (1.0 - OWN_NUMBERS)})
            changed = _torque(s, (*s.effects[:i], moved, *s.effects[i + 1 :])) - s.torque_nm
            if np.any(changed):
                found.append(s.finish(changed))
    return found


def _torque(s: ActuatorSignals, effects: Sequence[Effect]) -> Array:
    return nominal_torque_nm(effects, s.request_nm, s.position_rad, s.velocity_rad_s, s.stack.run, s.period_s)
