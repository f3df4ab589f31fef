"""What the drive does to a torque without a limit: gain, rotor inertia, lag, heat, ripple, play."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelView, Flags, Shape, Views
from diagnosis.channels.drive.actuator import ActuatorSignals
from diagnosis.library.base import ALL_OF_IT, STEPS, Coefficient, Grid, LibraryEffect, on_joints
from diagnosis.library.effects.order_spectrum import slow_orders, strongest_orders
from diagnosis.library.experiments import LONG_WALK, OTHER_KP, SLOW_WALK, STAND, Experiment
from spot_model.effects.base import Effect
from spot_model.effects.drive.armature import Armature
from spot_model.effects.drive.torque_bandwidth import TorqueBandwidth
from spot_model.effects.drive.torque_delay import TorqueDelay
from spot_model.effects.drive.torque_gain import TorqueGain
from spot_model.effects.drive.torque_offset import TorqueOffset
from spot_model.effects.drive.torque_ripple import TorqueRipple
from spot_model.effects.limits.thermal_derating import ThermalDerating


class TorqueGainEntry(LibraryEffect):
    """(g − 1)·τ: the motor gives a constant share."""

    title: ClassVar[str] = "torque gain"
    effect: ClassVar[type[Effect]] = TorqueGain
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("gain", "1", -0.9, 2.0),)
    confused_with: ClassVar[tuple[str, ...]] = (
        "load_sensor_gain",
        "thermal_derating",
        "load_friction",
        "torque_limit",
        "position_torque_limit",
    )
    split_by: ClassVar[Experiment] = OTHER_KP


class ArmatureEntry(LibraryEffect):
    """−I·q̈: torque that accelerates the rotor; the load is measured behind it."""

    title: ClassVar[str] = "reflected rotor inertia"
    effect: ClassVar[type[Effect]] = Armature
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("inertia_kg_m2", "kg·m²", 0.0, 0.5),)
    confused_with: ClassVar[tuple[str, ...]] = ("torque_bandwidth", "power_limit")
    split_by: ClassVar[Experiment] = SLOW_WALK


class BandwidthEntry(LibraryEffect):
    """A first-order lag of the torque."""

    title: ClassVar[str] = "slow torque loop"
    effect: ClassVar[type[Effect]] = TorqueBandwidth
    coefficients: ClassVar[tuple[Coefficient, ...]] = (ALL_OF_IT,)
    grid: ClassVar[Grid] = {"time_constant_s": (0.001, 0.002, 0.004, 0.008, 0.016, 0.032)}
    nearby: ClassVar[Grid] = {"time_constant_s": STEPS}
    confused_with: ClassVar[tuple[str, ...]] = ("torque_delay", "armature", "viscous_friction")
    split_by: ClassVar[Experiment] = OTHER_KP

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The slow torque less the torque."""
        s: ActuatorSignals = view.signals
        return on_joints(s.finish(s.low_pass(s.torque_nm, shape["time_constant_s"]) - s.torque_nm), joints)


class DelayEntry(LibraryEffect):
    """The torque that was asked for a while ago; a delay that all joints share is in part the load's lag."""

    title: ClassVar[str] = "delay of the torque"
    effect: ClassVar[type[Effect]] = TorqueDelay
    coefficients: ClassVar[tuple[Coefficient, ...]] = (ALL_OF_IT,)
    grid: ClassVar[Grid] = {"delay_s": (0.001, 0.002, 0.004, 0.008, 0.016)}
    nearby: ClassVar[Grid] = {"delay_s": STEPS}
    confused_with: ClassVar[tuple[str, ...]] = ("torque_bandwidth", "command_delay", "load_sensor_gain")
    split_by: ClassVar[Experiment] = OTHER_KP

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The late torque less the torque."""
        s: ActuatorSignals = view.signals
        return on_joints(s.finish(s.delayed(s.torque_nm, shape["delay_s"]) - s.torque_nm), joints)


class ThermalEntry(LibraryEffect):
    """−k·θ·τ with the rise θ heated by τ²; heating and cooling as the simulator's defaults, so k alone is fitted."""

    title: ClassVar[str] = "loss of torque with heat"
    effect: ClassVar[type[Effect]] = ThermalDerating
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("loss_per_k", "1/K", 0.0, 0.1),)
    confused_with: ClassVar[tuple[str, ...]] = ("torque_gain", "bus_sag")
    split_by: ClassVar[Experiment] = LONG_WALK


class TorqueOffsetEntry(LibraryEffect):
    """A constant beside what is asked for: there while the robot stands, too, unlike a ripple.

    The load is right and so is the motion it makes: a load cell's zero shows in the body's channels as well, an
    encoder's in those alone. Without them, or where the load is computed from the motor's own current, a torque and a
    zero are one. Where the asked torque hardly changes, a gain is the same.
    """

    title: ClassVar[str] = "constant torque"
    effect: ClassVar[type[Effect]] = TorqueOffset
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("offset_nm", "N·m", -20.0, 20.0),)
    confused_with: ClassVar[tuple[str, ...]] = ("load_sensor_gain", "torque_gain", "torque_ripple", "encoder_offset")
    split_by: ClassVar[Experiment] = STAND


class RippleEntry(LibraryEffect):
    """a·sin(n·q + φ) and its second harmonic: lines in the order spectrum."""

    title: ClassVar[str] = "torque ripple"
    effect: ClassVar[type[Effect]] = TorqueRipple
    coefficients: ClassVar[tuple[Coefficient, ...]] = (
        Coefficient("sine_nm", "N·m", -10.0, 10.0),
        Coefficient("cosine_nm", "N·m", -10.0, 10.0),
        Coefficient("second_sine_nm", "N·m", -5.0, 5.0),
        Coefficient("second_cosine_nm", "N·m", -5.0, 5.0),
    )
    confused_with: ClassVar[tuple[str, ...]] = ("coulomb_friction", "torque_offset")
    split_by: ClassVar[Experiment] = SLOW_WALK

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """The strongest slow lines, of which a leg's swing holds a wave or two, and those of the order spectrum."""
        view = views[Channel.SET_POINT_TO_LOAD]
        s: ActuatorSignals = view.signals
        at, usable = s.position_rad[s.kept], view.usable & joints
        trends = (s.finish(s.torque_nm), s.finish(s.velocity_rad_s), s.finish_rate(s.velocity_rad_s))
        legs = view.leg_of_joint
        within = np.array([np.sum(legs[:j] == leg) for j, leg in enumerate(legs)])
        sets = np.array([*np.eye(len(legs)), *(within == k for k in np.unique(within)), np.ones(len(legs))]) > 0.0
        slow = slow_orders(at, view.response, np.stack(trends, axis=2), usable, sets)
        return tuple({"cycles_per_rad": n} for n in (*slow, *strongest_orders(at, view.response, usable)))

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """Orders nearby, and the second harmonic where it is the one that was found."""
        n = shape["cycles_per_rad"]
        near = [n + d for d in (-0.5, -0.25, -0.12, 0.12, 0.25, 0.5) if n + d >= 1.0]
        return tuple({"cycles_per_rad": order} for order in (*near, 2.0 * n))

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Amplitudes, order and phases."""
        sine, cosine, second_sine, second_cosine = (float(c) for c in coefficients)
        return {
            "amplitude_nm": float(np.hypot(sine, cosine)),
            "cycles_per_rad": float(shape["cycles_per_rad"]),
            "phase_rad": float(np.arctan2(cosine, sine)),
            "second_nm": float(np.hypot(second_sine, second_cosine)),
            "second_phase_rad": float(np.arctan2(second_cosine, second_sine)),
        }
