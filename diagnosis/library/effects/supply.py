"""Bounds that all joints share: total power, and the bus voltage that sags with the total current."""

from __future__ import annotations

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
        found: list[Shape] = []
        coppers = {0.0, DEFAULT_COPPER_W_PER_NM2}
        if Channel.BATTERY_POWER in views and "copper_w_per_nm2" in views[Channel.BATTERY_POWER].measured:
            coppers.add(round(max(0.0, views[Channel.BATTERY_POWER].measured["copper_w_per_nm2"]), 4))
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

    def polished(self, shape: Shape, factors: Array) -> Shape | None:
        """Bound and copper loss."""
        power, copper = shape["power_w"] * float(factors[0]), shape["copper_w_per_nm2"] * float(factors[1])
        return {"power_w": power, "copper_w_per_nm2": copper} if power >= 50.0 and copper <= 1.0 else None


def _asked_w(s: ActuatorSignals, copper_w_per_nm2: float) -> Array:
    """Mechanical plus copper power that all joints ask for, shape (N,), W."""
    mechanical = np.maximum(s.torque_nm * s.velocity_rad_s, 0.0)
    return np.asarray(np.sum(mechanical + copper_w_per_nm2 * s.torque_nm**2, axis=1))


class BusSagEntry(LibraryEffect):
    """Driving torque bounded by back-EMF against a voltage that falls with the total current.

    Numbers that logs tell: stall torque and no-load speed at full voltage, and the resistance. The open voltage is the
    battery's where it was recorded.
    """

    title: ClassVar[str] = "sagging bus voltage"
    effect: ClassVar[type[Effect]] = BusSag
    location: ClassVar[Location] = Location.ROBOT
    coefficients: ClassVar[tuple[Coefficient, ...]] = (ALL_OF_IT,)
    confused_with: ClassVar[tuple[str, ...]] = ("power_limit", "torque_speed_curve", "backlash")
    split_by: ClassVar[Experiment] = SPRINT

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """No-load speeds and stall torques around what occurs, and resistances."""
        s: ActuatorSignals = views[Channel.SET_POINT_TO_LOAD].signals
        open_v, measured_ohm = supply(views)
        fastest = float(np.quantile(np.abs(s.velocity_rad_s[s.stack.used]), 0.9995))
        largest = float(np.quantile(np.abs(s.torque_nm[s.stack.used]), 0.999))
        resistances = sorted({0.05, 0.2, 0.6, round(measured_ohm, 4)} - {0.0})
        return tuple(
            _sag(ohm, open_v, no_load * fastest, stall * largest)
            for ohm in resistances
            for no_load in (0.9, 1.15, 1.5, 2.2)
            for stall in (0.7, 1.2, 2.5, 8.0)
        )

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """One number changed at a time."""
        ohm, open_v = shape["resistance_ohm"], shape["open_voltage_v"]
        emf, stall = shape["back_emf_v_s_per_rad"], shape["stall_nm_per_v"]
        found = [_plain(ohm * f, open_v, emf, stall) for f in (0.6, 0.8, 1.25, 1.6) if ohm * f <= 2.0]
        found += [_plain(ohm, open_v, emf * f, stall) for f in (0.85, 0.93, 1.08, 1.17)]
        found += [_plain(ohm, open_v, emf, stall * f) for f in (0.7, 0.85, 1.17, 1.4)]
        return tuple(found)

    n_free: ClassVar[int] = 3

    def polished(self, shape: Shape, factors: Array) -> Shape | None:
        """Resistance, back-EMF and stall torque."""
        ohm, emf, stall = (
            shape[name] * float(f)
            for name, f in zip(("resistance_ohm", "back_emf_v_s_per_rad", "stall_nm_per_v"), factors, strict=True)
        )
        return _plain(ohm, shape["open_voltage_v"], emf, stall) if ohm <= 2.0 and emf <= 10.0 and stall >= 0.1 else None

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """What the voltage that is left cuts off, with the current from the measured loads."""
        s: ActuatorSignals = view.signals
        open_v = shape["open_voltage_v"]
        power = np.sum(np.maximum(s.load_nm * s.velocity_rad_s, 0.0), axis=1, keepdims=True)
        current = s.low_pass(power / open_v, BusSag().smoothing_s)
        headroom = open_v - shape["resistance_ohm"] * current - shape["back_emf_v_s_per_rad"] * np.abs(s.velocity_rad_s)
        bound = shape["stall_nm_per_v"] * np.maximum(headroom, 0.0)
        driving = s.torque_nm * s.velocity_rad_s > 0.0
        cut = np.where(driving, np.clip(s.torque_nm, -bound, bound) - s.torque_nm, 0.0)
        return on_joints(s.finish(cut), joints)


def supply(views: Views) -> tuple[float, float]:
    """The battery's open voltage (V) and resistance (Ω) where the battery told them, else the simulator's and 0.1 Ω."""
    if Channel.BATTERY_POWER in views and "open_voltage_v" in views[Channel.BATTERY_POWER].measured:
        measured = views[Channel.BATTERY_POWER].measured
        return measured["open_voltage_v"], max(measured["resistance_ohm"], 0.0)
    return BusSag().open_voltage_v, 0.1


def _sag(ohm: float, open_v: float, no_load_rad_s: float, stall_nm: float) -> Shape:
    return _plain(ohm, open_v, open_v / no_load_rad_s, stall_nm / open_v)


def _plain(ohm: float, open_v: float, back_emf: float, stall: float) -> Shape:
    return {
        "resistance_ohm": float(ohm),
        "open_voltage_v": float(open_v),
        "back_emf_v_s_per_rad": float(min(back_emf, 10.0)),
        "stall_nm_per_v": float(max(stall, 0.1)),
    }
