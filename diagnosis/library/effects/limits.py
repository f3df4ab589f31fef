"""Bounds on a joint's own torque: flat, by speed, by position. Their size is their shape; the column is what is cut."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelView, Flags, Shape, Views
from diagnosis.channels.drive.actuator import ActuatorSignals
from diagnosis.library.base import ALL_OF_IT, CLOSE_STEPS, Coefficient, Grid, LibraryEffect
from diagnosis.library.experiments import SLOW_WALK, SPRINT, Experiment
from spot_model.effects.base import Effect
from spot_model.effects.limits.position_torque_limit import PositionTorqueLimit
from spot_model.effects.limits.torque_limit import TorqueLimit
from spot_model.effects.limits.torque_speed_curve import TorqueSpeedCurve
from spot_model.io.model_file import RobotModel
from spot_model.robot.knee_table import KNEE_TABLE_POSITION_RAD, KNEE_TABLE_RATIO


class _LimitEntry(LibraryEffect):
    coefficients: ClassVar[tuple[Coefficient, ...]] = (ALL_OF_IT,)

    def add_to(self, model: RobotModel, values: Mapping[str, float], joints: tuple[str, ...]) -> RobotModel:
        """A bound that is looser than the nominal one of the same kind and place replaces it."""
        new = self.make(values, joints)
        kept = tuple(e for e in model.effects if not (isinstance(e, self.effect) and np.array_equal(e.mask, new.mask)))
        return RobotModel(effects=(*kept, new), robot=model.robot)


def largest_nm(views: Views, joints: Flags) -> tuple[Array, float]:
    """Upper quantiles of the motor torque's size over usable samples of the joints, and the largest, N·m."""
    view = views[Channel.SET_POINT_TO_LOAD]
    s: ActuatorSignals = view.signals
    good = s.stack.used
    size = np.abs(s.torque_nm[good][:, joints]).ravel()
    if size.size == 0:
        return np.ones(1), 1.0
    return np.quantile(size, (0.4, 0.6, 0.75, 0.85, 0.92, 0.96, 0.98, 0.99, 0.995, 0.998)), float(size.max())


class TorqueLimitEntry(_LimitEntry):
    """A flat top."""

    title: ClassVar[str] = "flat torque limit"
    effect: ClassVar[type[Effect]] = TorqueLimit
    nearby: ClassVar[Grid] = {"limit_nm": CLOSE_STEPS}
    confused_with: ClassVar[tuple[str, ...]] = ("torque_gain", "thermal_derating", "position_torque_limit", "backlash")
    split_by: ClassVar[Experiment] = SPRINT

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """Limits within the torques that occur."""
        quantiles, _ = largest_nm(views, joints)
        return tuple({"limit_nm": float(q)} for q in np.unique(np.maximum(np.round(quantiles, 3), 1.0)))


class SpeedCurveEntry(_LimitEntry):
    """Driving torque that falls with speed; the same in both directions."""

    title: ClassVar[str] = "torque limit by speed"
    effect: ClassVar[type[Effect]] = TorqueSpeedCurve
    confused_with: ClassVar[tuple[str, ...]] = (
        "viscous_friction",
        "power_limit",
        "bus_sag",
        "torque_limit",
        "backlash",
    )
    split_by: ClassVar[Experiment] = SPRINT

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """Stall torque, no-load speed and corner, over what occurs."""
        view = views[Channel.SET_POINT_TO_LOAD]
        s: ActuatorSignals = view.signals
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
        found += [
            _curve(stall, no_load, min(max(corner + d * no_load, 0.0), 0.99 * no_load))
            for d in (-0.15, -0.05, 0.05, 0.15)
        ]
        for f in (0.8, 0.9, 0.95, 1.05, 1.1, 1.2):
            moved = no_load - f * (no_load - corner)
            if moved >= 0.0:
                found.append(_curve(stall * f, no_load, moved))
        return tuple(found)

    n_free: ClassVar[int] = 3


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

    title: ClassVar[str] = "torque limit by position"
    effect: ClassVar[type[Effect]] = PositionTorqueLimit
    nearby: ClassVar[Grid] = {"motor_torque_nm": CLOSE_STEPS}
    confused_with: ClassVar[tuple[str, ...]] = ("torque_limit", "torque_gain", "backlash")
    split_by: ClassVar[Experiment] = SLOW_WALK

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
