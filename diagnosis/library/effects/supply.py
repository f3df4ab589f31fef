"""Bounds that all joints share: total power, and the bus voltage that sags with the total current."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Final

import numpy as np

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelView, Flags, Shape, Views
from diagnosis.channels.drive.actuator import ActuatorSignals
from diagnosis.library.base import ALL_OF_IT, Coefficient, LibraryEffect, Location, on_joints
from diagnosis.library.experiments import SPRINT, Experiment
from spot_model.effects.base import Effect
from spot_model.effects.limits.bus_sag import BusSag
from spot_model.effects.limits.power_limit import PowerLimit
from spot_model.effects.limits.torque_speed_curve import TorqueSpeedCurve
from spot_model.io.model_file import RobotModel
from spot_model.robot.facts import JOINT_NAMES

DEFAULT_COPPER_W_PER_NM2: Final = 0.02
"""Tried beside none where the battery was not recorded."""


class PowerLimitEntry(LibraryEffect):
    """If all joints together ask for more than a bound, every driving torque is scaled down alike."""

    title: ClassVar[str] = "limit of the total power"
    effect: ClassVar[type[Effect]] = PowerLimit
    location: ClassVar[Location] = Location.ROBOT
    coefficients: ClassVar[tuple[Coefficient, ...]] = (ALL_OF_IT,)
    confused_with: ClassVar[tuple[str, ...]] = (
        "torque_speed_curve",
        "bus_sag",
        "armature",
        "thermal_derating",
        "backlash",
    )
    split_by: ClassVar[Experiment] = SPRINT

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """Bounds within the total power that is asked for, without and with copper loss."""
        s: ActuatorSignals = views[Channel.SET_POINT_TO_LOAD].signals
        coppers = {0.0, *copper_losses(views)}
        found: list[Shape] = []
        for copper in sorted(coppers):
            total = _asked_w(s, copper)[s.stack.used]
            quantiles = np.quantile(total, (0.5, 0.7, 0.8, 0.87, 0.92, 0.96, 0.98, 0.99, 0.995))
            found += [
                {"power_w": max(50.0, float(q)), "copper_w_per_nm2": copper} for q in np.unique(np.round(quantiles))
            ]
        return tuple(found)

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """Bounds nearby, another copper loss at the same place, and both: more loss under a higher bound is alike."""
        power, copper = shape["power_w"], shape["copper_w_per_nm2"]
        found = [{"power_w": max(50.0, power * f), "copper_w_per_nm2": copper} for f in (0.88, 0.94, 1.06, 1.13)]
        for d, factors in ((-0.01, (1.0, 0.94, 0.88)), (0.01, (1.0, 1.06, 1.13))):
            if 0.0 <= copper + d <= 1.0:
                found += [{"power_w": max(50.0, power * f), "copper_w_per_nm2": copper + d} for f in factors]
        return tuple(found)

    n_free: ClassVar[int] = 2


def _asked_w(s: ActuatorSignals, copper_w_per_nm2: float) -> Array:
    """Mechanical plus copper power that all joints ask for, shape (N,), W."""
    mechanical = np.maximum(s.torque_nm * s.velocity_rad_s, 0.0)
    return np.asarray(np.sum(mechanical + copper_w_per_nm2 * s.torque_nm**2, axis=1))


class BusSagEntry(LibraryEffect):
    """Driving torque bounded by back-EMF against a voltage that falls with the power of all motors.

    Numbers that logs tell: the resistance, and the motors' stall torque and no-load speed at full voltage, of which the
    nominal model's own curves are tried first. The open voltage is the battery's where it was recorded.
    """

    title: ClassVar[str] = "sagging bus voltage"
    effect: ClassVar[type[Effect]] = BusSag
    location: ClassVar[Location] = Location.ROBOT
    coefficients: ClassVar[tuple[Coefficient, ...]] = (ALL_OF_IT,)
    confused_with: ClassVar[tuple[str, ...]] = ("power_limit", "torque_speed_curve", "backlash")
    split_by: ClassVar[Experiment] = SPRINT

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """Resistances and copper losses beside the nominal curves, as they are and slower."""
        s: ActuatorSignals = views[Channel.SET_POINT_TO_LOAD].signals
        open_v, measured_ohm = supply(views)
        lines = [(f * no_load, stall) for no_load, stall in nominal_lines(s.effects) for f in (1.0, 0.8)]
        if not lines:
            fastest = float(np.quantile(np.abs(s.velocity_rad_s[s.stack.used]), 0.9995))
            largest = float(np.quantile(np.abs(s.torque_nm[s.stack.used]), 0.999))
            lines = [(f * fastest, g * largest) for f in (0.9, 1.15, 1.5, 2.2) for g in (0.7, 1.2, 2.5, 8.0)]
        resistances = sorted({0.05, 0.2, 0.6, 1.2, round(measured_ohm, 4)} - {0.0})
        return tuple(
            _plain(ohm, open_v, open_v / no_load, stall / open_v, copper)
            for ohm in resistances
            for no_load, stall in lines
            for copper in copper_losses(views)
        )

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """One number changed at a time."""
        ohm, open_v, copper = shape["resistance_ohm"], shape["open_voltage_v"], shape["copper_w_per_nm2"]
        emf, stall = shape["back_emf_v_s_per_rad"], shape["stall_nm_per_v"]
        found = [_plain(ohm * f, open_v, emf, stall, copper) for f in (0.6, 0.8, 1.25, 1.6) if ohm * f <= 2.0]
        found += [_plain(ohm, open_v, emf * f, stall, copper) for f in (0.85, 0.93, 1.08, 1.17)]
        found += [_plain(ohm, open_v, emf, stall * f, copper) for f in (0.7, 0.85, 1.17, 1.4)]
        found += [_plain(ohm, open_v, emf, stall, copper * f) for f in (0.7, 1.4)]
        return tuple(found)

    n_free: ClassVar[int] = 4

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """What is cut at the joints that the voltage bounds."""
        s: ActuatorSignals = view.signals
        sag = BusSag(joints=("all",), **shape)
        bounded = curved(s.effects)
        return on_joints(s.finish(s.torque_after_nm(sag) - s.torque_nm), joints & np.resize(bounded, len(joints)))

    def add_to(self, model: RobotModel, values: Mapping[str, float], joints: tuple[str, ...]) -> RobotModel:
        """At the joints that the voltage bounds."""
        bounded = tuple(name for name, is_bounded in zip(JOINT_NAMES, curved(model.effects), strict=True) if is_bounded)
        return model.with_effects(self.make(values, joints if len(bounded) == len(JOINT_NAMES) else bounded))


def curved(effects: Sequence[Effect]) -> Flags:
    """Joints whose torque the nominal model bounds by speed, shape (12,); all if it bounds none.

    The others' motors have speed to spare: a lower voltage takes nothing of theirs.
    """
    masks = [e.mask for e in effects if isinstance(e, TorqueSpeedCurve) and np.isfinite(e.speed_max_rad_s)]
    return np.any(masks, axis=0) if masks else np.ones(len(JOINT_NAMES), dtype=np.bool_)


def nominal_lines(effects: Sequence[Effect]) -> tuple[tuple[float, float], ...]:
    """No-load speed (rad/s) and stall torque (N·m) of the falling lines that the nominal model's drives have."""
    curves = [e for e in effects if isinstance(e, TorqueSpeedCurve) and np.isfinite(e.speed_max_rad_s)]
    return tuple(
        (c.speed_max_rad_s, c.torque_max_nm * c.speed_max_rad_s / (c.speed_max_rad_s - c.intersect_max_rad_s))
        for c in curves
        if c.speed_max_rad_s > c.intersect_max_rad_s
    )


def supply(views: Views) -> tuple[float, float]:
    """The battery's open voltage (V) and resistance (Ω) where the battery told them, else the simulator's and 0.1 Ω."""
    if Channel.BATTERY_POWER in views and "open_voltage_v" in views[Channel.BATTERY_POWER].measured:
        measured = views[Channel.BATTERY_POWER].measured
        return measured["open_voltage_v"], max(measured["resistance_ohm"], 0.0)
    return BusSag().open_voltage_v, 0.1


def copper_losses(views: Views) -> tuple[float, ...]:
    """The windings' loss: the usual, and what the battery told if it told one; W/(N·m)²."""
    measured = views[Channel.BATTERY_POWER].measured if Channel.BATTERY_POWER in views else {}
    found = round(measured.get("copper_w_per_nm2", 0.0), 4)
    return tuple(sorted({DEFAULT_COPPER_W_PER_NM2, *([found] if found > 0.0 else [])}))


def _plain(ohm: float, open_v: float, back_emf: float, stall: float, copper: float) -> Shape:
    return {
        "resistance_ohm": float(ohm),
        "open_voltage_v": float(open_v),
        "back_emf_v_s_per_rad": float(min(back_emf, 10.0)),
        "stall_nm_per_v": float(max(stall, 0.1)),
        "copper_w_per_nm2": float(min(copper, 1.0)),
    }
