"""The library: every effect that the diagnosis knows, by name, and those of a user's own (``--add-effect``)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from importlib.metadata import EntryPoint
from typing import ClassVar, Final

import numpy as np

from diagnosis.channels import Array, Shape
from diagnosis.library import (
    ALL_OF_IT,
    Coefficient,
    LibraryEffect,
    contact,
    drive,
    ground,
    joint_sensing,
    limits,
    program,
    rigid_body,
    ripple,
)
from spot_model.effects.base import Effect, Parameter, TorqueEffect
from spot_model.errors import BadInputError
from spot_model.plant.model_fields import has_joint_loss
from spot_model.user_code import users_code
from trainer.signals.motor_torque import torque_after_nm

LIBRARY: Final[dict[str, LibraryEffect]] = {
    entry.name: entry
    for entry in (
        drive.CoulombEntry(),
        drive.ViscousEntry(),
        drive.StribeckEntry(),
        drive.LoadFrictionEntry(),
        drive.TorqueGainEntry(),
        limits.TorqueLimitEntry(),
        limits.SpeedCurveEntry(),
        limits.PositionLimitEntry(),
        drive.ArmatureEntry(),
        drive.BandwidthEntry(),
        drive.DelayEntry(),
        program.CommandDelayEntry(),
        program.CommandJitterEntry(),
        program.CommandDropEntry(),
        drive.ThermalEntry(),
        drive.TorqueOffsetEntry(),
        ripple.RippleEntry(),
        limits.PowerLimitEntry(),
        limits.BusSagEntry(),
        drive.BacklashEntry(),
        joint_sensing.JointComplianceEntry(),
        joint_sensing.EncoderOffsetEntry(),
        joint_sensing.LoadSensorEntry(),
        joint_sensing.LoadFilterEntry(),
        joint_sensing.SensorNoiseEntry(),
        joint_sensing.VelocityFilterEntry(),
        contact.VelocityEstimateEntry(),
        rigid_body.PayloadEntry(),
        rigid_body.SwingingMassEntry(),
        rigid_body.ComEntry(),
        rigid_body.InertiaEntry(),
        rigid_body.LegMassEntry(),
        contact.FootRadiusEntry(),
        contact.GroundFrictionEntry(),
        contact.GroundComplianceEntry(),
        contact.ContactDelayEntry(),
        contact.ImuTiltEntry(),
        ground.GroundSlopeEntry(),
        ground.FootDragEntry(),
        program.ActionScaleEntry(),
        program.DefaultPoseEntry(),
        program.JointSwapEntry(),
    )
}
"""42 effects. A leg that differs from the others is any of them at that leg's joints; a robot that does not follow its
commands is no effect but a cut (:mod:`diagnosis.read.segments`)."""


COARSE: Final = 5
"""Values of a shape parameter that are tried first, evenly over its bounds."""
FINER: Final = (1 / 8, 1 / 24, 1 / 72)
"""Steps of the search around the best of them, in shares of the bounds' distance."""
MAX_SHAPES: Final = 125
WIDEST: Final = 1e4
"""Bounds farther apart than this cannot be searched evenly."""


def chosen_library(added: Sequence[str | type], left_out: Sequence[str]) -> dict[str, LibraryEffect]:
    """The library with effects added, each as ``module:Class`` or the class itself, and left out by name.

    Raises:
        BadInputError: A name is unknown, or a class cannot be loaded.
    """
    library = dict(LIBRARY)
    for name in left_out:
        if name not in LIBRARY:
            raise BadInputError(f"--without {name!r} is not in the library; allowed: {', '.join(LIBRARY)}")
        library.pop(name, None)
    for value in added:
        effect = _load(value)
        if effect.name in library:
            raise BadInputError(
                f"--add-effect {value!r} is named {effect.name!r}, as one of the library is; rename it, or leave the "
                f"library's out with --without {effect.name}"
            )
        library[effect.name] = effect
    if not library:
        raise BadInputError("the library is empty; leave at least one effect in it")
    return library


def _load(value: object) -> LibraryEffect:
    with users_code(f"--add-effect {value!r}", "is it on the Python path, and whole?"):
        made: object = value
        if not isinstance(value, type):
            if not isinstance(value, str) or value.count(":") != 1:
                raise BadInputError(
                    f"--add-effect {value!r}; allowed: module:Class, a subclass of Effect or LibraryEffect"
                )
            made = EntryPoint(name="effect", value=value, group="spot_rl.library").load()
        if isinstance(made, type) and issubclass(made, Effect):
            return library_entry(made)
        if not (isinstance(made, type) and issubclass(made, LibraryEffect)):
            raise BadInputError(f"--add-effect {value!r} is no Effect of spot_model.effects.base, and no LibraryEffect")
        for needed in ("effect", "coefficients"):
            if not hasattr(made, needed):
                raise BadInputError(f"--add-effect {value!r} lacks the attribute {needed}; write it")
        try:
            effect: LibraryEffect = made()
        except TypeError as error:
            raise BadInputError(f"--add-effect {value!r} cannot be made: {error}; write what is missing") from error
        return effect


def library_entry(effect: type[Effect]) -> LibraryEffect:
    """An entry whose coefficients and shape are the effect's parameters.

    A parameter that alone, the others at their null values, changes the torque in proportion to itself is a
    coefficient; any other is searched over its bounds.

    Raises:
        BadInputError: The effect changes no torque between set-point and load, or has nothing to fit.
    """
    if not (issubclass(effect, TorqueEffect) or has_joint_loss(effect())):
        raise BadInputError(
            f"effect {effect.name} changes no torque between set-point and load; write a LibraryEffect with its columns"
        )
    sizes = tuple(p for p in effect.parameters() if _is_size(effect, p))
    shape = tuple(p for p in effect.parameters() if p not in sizes)
    for p in shape:
        if not 0.0 < p.high - p.low < WIDEST:
            raise BadInputError(
                f"{effect.name}.{p.name} cannot be searched from {p.low:g} to {p.high:g}; bound it closer"
            )
    if not sizes and not shape:
        raise BadInputError(f"effect {effect.name} has no parameter to fit; give it one with parameter(...)")
    coefficients = tuple(Coefficient(p.name, p.unit, p.low - p.null, p.high - p.null) for p in sizes) or (ALL_OF_IT,)
    per = max(2, min(COARSE, int(MAX_SHAPES ** (1 / max(1, len(shape))))))
    grid = {p.name: tuple(np.linspace(p.low, p.high, per).tolist()) for p in shape}
    stated = {"effect": effect, "coefficients": coefficients, "searched": shape, "grid": grid}
    made: type[LibraryEffect] = type(f"{effect.__name__}Entry", (_PlainEntry,), {"__doc__": effect.__doc__, **stated})
    return made()


class _PlainEntry(LibraryEffect):
    searched: ClassVar[tuple[Parameter, ...]]

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """One parameter changed at a time, by steps of several sizes."""
        return tuple(
            {**shape, p.name: shape[p.name] + sign * share * (p.high - p.low)}
            for p in self.searched
            for share in FINER
            for sign in (-1.0, 1.0)
        )


def _is_size(effect: type[Effect], p: Parameter) -> bool:
    """Whether the parameter alone changes a torque in proportion to how far it is from its null value."""
    if not math.isfinite(p.null):
        return False
    if not issubclass(effect, TorqueEffect):
        return True
    rng = np.random.default_rng(0)
    torque, position, velocity = (size * rng.standard_normal((64, 12)) for size in (20.0, 1.0, 5.0))
    one_run = np.zeros(len(torque), dtype=np.intp)
    step = 0.01 * ((p.high if math.isfinite(p.high) else 1.0) - p.null or p.low - p.null)

    def added(share: float) -> Array:
        moved = effect(joints=("all",), **{p.name: p.null + share * step})
        return torque_after_nm(moved, torque, position, velocity, one_run, 0.003) - torque

    one, two = added(0.5), added(1.0)
    return bool(np.any(two) and np.allclose(two, 2.0 * one, atol=1e-6 * np.max(np.abs(two))))
