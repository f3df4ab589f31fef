"""Bounds on the torque: a joint's own, flat, by speed or position, and those that all share, of power and voltage.

Their size is their shape; the column is what is cut.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Final

import numpy as np
from scipy.signal import lfilter

from diagnosis.channels import Array, Channel, ChannelView, Flags, Shape, Views
from diagnosis.channels.actuator import ActuatorSignals
from diagnosis.channels.sensors import PowerSignals
from diagnosis.library import ALL_OF_IT, CLOSE_STEPS, LibraryEffect, Location, ShapeGrid, on_joints
from diagnosis.library.experiments import SLOW_WALK
from spot_model.effects.base import Effect
from spot_model.effects.power import BusSag, PowerLimit
from spot_model.effects.torque_limits import PositionTorqueLimit, TorqueLimit, TorqueSpeedCurve
from spot_model.io.model_file import RobotModel
from spot_model.robot.facts import JOINT_NAMES, KNEE_TABLE_POSITION_RAD, KNEE_TABLE_RATIO

BEYOND_SUPPLY: Final = 0.01
"""Share of samples, of noisy loads, at which a supply may be asked for more than it can give."""
RESISTANCES_OHM: Final = (0.05, 0.2, 0.6, 1.2)
"""Tried beside what the battery told, if it did: a new battery with its wiring, an old one, bad contacts."""
SAG_ALIKE_NM: Final = 1e-3
"""Rounds that differ by less are the last."""
DEFAULT_COPPER_W_PER_NM2: Final = 0.02
"""Tried beside none where the battery was not recorded."""


class _LimitEntry(LibraryEffect):
    family = "a torque limit"
    coefficients = (ALL_OF_IT,)

    def add_to(self, model: RobotModel, values: Mapping[str, float], joints: tuple[str, ...]) -> RobotModel:
        """A bound that is looser than the nominal one of the same kind and place replaces it."""
        new = self.make(values, joints)
        kept = tuple(e for e in model.effects if not (isinstance(e, self.effect) and np.array_equal(e.mask, new.mask)))
        return RobotModel((*kept, new))


def largest_nm(views: Views, joints: Flags) -> tuple[Array, float]:
    """Upper quantiles of the motor torque's size over usable samples of the joints, and the largest, N·m."""
    s: ActuatorSignals = views[Channel.SET_POINT_TO_LOAD].signals
    size = np.abs(s.torque_nm[s.stack.used][:, joints]).ravel()
    if size.size == 0:
        return np.ones(1), 1.0
    return np.quantile(size, (0.4, 0.6, 0.75, 0.85, 0.92, 0.96, 0.98, 0.99, 0.995, 0.998)), float(size.max())


class TorqueLimitEntry(_LimitEntry):
    """A flat top."""

    title = "flat torque limit"
    effect = TorqueLimit
    nearby: ClassVar[ShapeGrid] = {"limit_nm": CLOSE_STEPS}
    confused_with = ("torque_gain", "thermal_derating", "position_torque_limit", "backlash")

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """Limits within the torques that occur."""
        quantiles, _ = largest_nm(views, joints)
        return tuple({"limit_nm": float(q)} for q in np.unique(np.maximum(np.round(quantiles, 3), 1.0)))


class SpeedCurveEntry(_LimitEntry):
    """Driving torque that falls with speed; the same in both directions."""

    title = "torque limit by speed"
    effect = TorqueSpeedCurve
    confused_with = ("viscous_friction", "power_limit", "bus_sag", "torque_limit", "backlash")

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """Stall torque, no-load speed and corner, over what occurs."""
        s: ActuatorSignals = views[Channel.SET_POINT_TO_LOAD].signals
        speeds = np.abs(s.still_velocity_rad_s[s.stack.used][:, joints])
        fastest = float(np.quantile(speeds, 0.999)) if speeds.size else 1.0
        quantiles, largest = largest_nm(views, joints)
        return tuple(
            _curve(float(stall), no_load * fastest, corner * no_load * fastest)
            for stall in np.unique(np.round([quantiles[5], quantiles[7], largest, 1.5 * largest, 3.0 * largest], 3))
            for no_load in (0.7, 0.85, 1.0, 1.2, 1.5)
            for corner in (0.0, 0.4, 0.7)
        )

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """One number changed at a time, and the flat top moved along the falling line."""
        stall, no_load, corner = shape["torque_max_nm"], shape["speed_max_rad_s"], shape["intersect_max_rad_s"]
        found = [_curve(stall * f, no_load, corner) for f in (0.85, 0.93, 1.07, 1.15)]
        found += [_curve(stall, no_load * f, min(corner, no_load * f)) for f in (0.9, 0.96, 1.04, 1.1)]
        corners = (min(max(corner + d * no_load, 0.0), 0.99 * no_load) for d in (-0.15, -0.05, 0.05, 0.15))
        found += [_curve(stall, no_load, moved) for moved in corners]
        along = [(f, no_load - f * (no_load - corner)) for f in (0.8, 0.9, 0.95, 1.05, 1.1, 1.2)]
        return (*found, *(_curve(stall * f, no_load, moved) for f, moved in along if moved >= 0.0))


def _curve(stall_nm: float, no_load_rad_s: float, corner_rad_s: float) -> Shape:
    return {
        "torque_max_nm": stall_nm,
        "torque_min_nm": -stall_nm,
        "speed_max_rad_s": no_load_rad_s,
        "speed_min_rad_s": -no_load_rad_s,
        "intersect_max_rad_s": corner_rad_s,
        "intersect_min_rad_s": -corner_rad_s,
    }


class PositionLimitEntry(_LimitEntry):
    """The knee's limit by angle."""

    title = "torque limit by position"
    effect = PositionTorqueLimit
    nearby: ClassVar[ShapeGrid] = {"motor_torque_nm": CLOSE_STEPS}
    confused_with = ("torque_limit", "torque_gain", "backlash")
    split_by = SLOW_WALK

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """Motor torques within what occurs, over the transmission ratio."""
        s: ActuatorSignals = views[Channel.SET_POINT_TO_LOAD].signals
        ratio = np.abs(np.interp(s.position_rad, KNEE_TABLE_POSITION_RAD, KNEE_TABLE_RATIO))
        motor = (np.abs(s.torque_nm) / ratio)[s.stack.used][:, joints].ravel()
        if motor.size == 0:
            return ({"motor_torque_nm": 1.0},)
        quantiles = np.quantile(motor, (0.6, 0.75, 0.85, 0.92, 0.96, 0.98, 0.99, 0.995, 0.998))
        return tuple({"motor_torque_nm": max(0.05, float(q))} for q in np.unique(np.round(quantiles, 4)))

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """What the limit cuts off, at the knees."""
        return super().columns(view, shape, joints & np.array([name.endswith("_kn") for name in view.rows]))


class PowerLimitEntry(LibraryEffect):
    """If all joints together ask for more than a bound, every driving torque is scaled down alike."""

    title = "limit of the total power"
    family = "a torque limit"
    effect = PowerLimit
    location = Location.ROBOT
    coefficients = (ALL_OF_IT,)
    confused_with = ("torque_speed_curve", "bus_sag", "armature", "thermal_derating", "backlash")

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """Bounds within the total power that is asked for, without and with copper loss."""
        s: ActuatorSignals = views[Channel.SET_POINT_TO_LOAD].signals
        found: list[Shape] = []
        for copper in (0.0, *copper_losses(views)):
            mechanical = np.maximum(s.torque_nm * s.velocity_rad_s, 0.0)
            total = np.sum(mechanical + copper * s.torque_nm**2, axis=1)[s.stack.used]
            quantiles = np.round(np.quantile(total, (0.5, 0.7, 0.8, 0.87, 0.92, 0.96, 0.98, 0.99, 0.995)))
            found += [_power(float(q), copper) for q in np.unique(quantiles)]
        return tuple(found)

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """Bounds nearby, another copper loss at the same place, and both: more loss under a higher bound is alike."""
        power, copper = shape["power_w"], shape["copper_w_per_nm2"]
        found = [_power(power * f, copper) for f in (0.88, 0.94, 1.06, 1.13)]
        for d, factors in ((-0.01, (1.0, 0.94, 0.88)), (0.01, (1.0, 1.06, 1.13))):
            found += [_power(power * f, copper + d) for f in factors]
        return tuple(found)


def _power(power_w: float, copper_w_per_nm2: float) -> Shape:
    return {"power_w": max(50.0, power_w), "copper_w_per_nm2": copper_w_per_nm2}


class BusSagEntry(LibraryEffect):
    """Driving torque bounded by back-EMF against a voltage that falls with the power of all motors.

    Numbers that logs tell: the resistance, and the motors' stall torque and no-load speed at full voltage, of which the
    nominal model's own curves are tried first. Open voltage and resistance begin with the battery's where it was
    recorded. A supply that could not give the power of the measured loads explains nothing.
    """

    title = "sagging bus voltage"
    family = "a torque limit"
    effect = BusSag
    location = Location.ROBOT
    coefficients = (ALL_OF_IT,)
    confused_with = ("power_limit", "torque_speed_curve", "backlash")
    nearby: ClassVar[ShapeGrid] = {
        "resistance_ohm": (0.6, 0.8, 1.25, 1.6),
        "back_emf_v_s_per_rad": (0.85, 0.93, 1.08, 1.17),
        "stall_nm_per_v": (0.7, 0.85, 1.17, 1.4),
        "copper_w_per_nm2": (0.7, 1.4),
    }

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """Resistances and copper losses beside the nominal curves, as they are and slower."""
        s: ActuatorSignals = views[Channel.SET_POINT_TO_LOAD].signals
        open_v, measured_ohm = supply(views)
        slower = ((1.0, 1.0), (0.8, 1.0), (0.5, 0.7))
        lines = [(f * no_load, g * stall) for no_load, stall in nominal_lines(s.effects) for f, g in slower]
        if not lines:
            fastest = float(np.quantile(np.abs(s.velocity_rad_s[s.stack.used]), 0.9995))
            largest = float(np.quantile(np.abs(s.torque_nm[s.stack.used]), 0.999))
            lines = [(f * fastest, g * largest) for f in (0.9, 1.15, 1.5, 2.2) for g in (0.7, 1.2, 2.5, 8.0)]
        told = (round(measured_ohm, 4),) if measured_ohm > 0.0 else ()
        # Refinement reaches what is within a factor of four; wiring behind the battery's terminals may add more.
        resistances = (*told, *(ohm for ohm in RESISTANCES_OHM if ohm > 4.0 * measured_ohm))
        return tuple(
            {
                "resistance_ohm": ohm,
                "open_voltage_v": open_v,
                "back_emf_v_s_per_rad": min(open_v / no_load, 10.0),
                "stall_nm_per_v": max(stall / open_v, 0.1),
                "copper_w_per_nm2": min(copper, 1.0),
            }
            for ohm in resistances
            for no_load, stall in lines
            for copper in copper_losses(views)
        )

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """What is cut at the joints that the voltage bounds; 0 for a supply that cannot give what the motors drew."""
        s: ActuatorSignals = view.signals
        sag = BusSag(joints=("all",), **shape)
        bounded = curved(s.effects) & could_give(s, sag)
        return on_joints(added_by_sag_nm(s, sag), joints & np.resize(bounded, len(joints)))

    def add_to(self, model: RobotModel, values: Mapping[str, float], joints: tuple[str, ...]) -> RobotModel:
        """At the joints that the voltage bounds."""
        bounded = tuple(name for name, is_bounded in zip(JOINT_NAMES, curved(model.effects), strict=True) if is_bounded)
        return model.with_effects(self.make(values, joints if len(bounded) == len(JOINT_NAMES) else bounded))


def could_give(s: ActuatorSignals, sag: BusSag) -> bool:
    """Whether the supply can give the power of the loads that were measured, V0²/(4·R) at most."""
    drawn = np.asarray(sag.power_w(s.load_nm, s.velocity_rad_s))[s.stack.used]
    return bool(np.mean(4.0 * sag.resistance_ohm * drawn > sag.open_voltage_v**2) <= BEYOND_SUPPLY)


def added_by_sag_nm(s: ActuatorSignals, sag: BusSag) -> Array:
    """:meth:`ActuatorSignals.added_nm` of a sagging voltage, in rounds over all rows in place of a step for each.

    The bound follows from the power before, and that from the bound. A round takes the power from the torque of the
    round before, beginning with what is asked for; each is right for longer than the last, and where nothing is cut
    the first is. Where the voltage breaks down, step by step is quicker.
    """
    keep = float(np.exp(-s.period_s / sag.smoothing_s))
    asked, velocity = s.torque_nm, s.velocity_rad_s
    torque, driving = asked, asked * velocity > 0.0
    for _ in range(8):
        drawn = np.asarray(sag.power_w(torque, velocity))
        drawn = s.stack.by_run(lambda part: lfilter([0.0, 1.0 - keep], [1.0, -keep], part, axis=0), drawn)
        bound = np.asarray(sag.bound_nm(drawn, velocity))
        before, torque = torque, np.where(driving, np.clip(asked, -bound, bound), asked)
        if np.max(np.abs(torque - before)) < SAG_ALIKE_NM:
            return s.finish(torque - asked)
    return s.added_nm(sag)


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
    """The battery's open voltage (V) and resistance (Ω); the simulator's and 0 where the battery does not tell them."""
    if Channel.BATTERY_POWER not in views:
        return BusSag().open_voltage_v, 0.0
    told: PowerSignals = views[Channel.BATTERY_POWER].signals
    return told.open_voltage_v, max(told.resistance_ohm, 0.0)


def copper_losses(views: Views) -> tuple[float, ...]:
    """The windings' loss, rising: the usual, and what the battery told if it told one; W/(N·m)²."""
    told: PowerSignals | None = views[Channel.BATTERY_POWER].signals if Channel.BATTERY_POWER in views else None
    found = 0.0 if told is None else round(told.copper_w_per_nm2, 4)
    return tuple(sorted({DEFAULT_COPPER_W_PER_NM2, *([found] if found > 0.0 else [])}))
