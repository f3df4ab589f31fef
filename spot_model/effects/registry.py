"""Finding an effect by name: the built-in ones, installed plug-ins, and ``module:Class``."""

from __future__ import annotations

import pkgutil
from importlib.metadata import entry_points
from typing import Any

from spot_model.effects.base import Effect
from spot_model.effects.body.body_inertia import BodyInertia
from spot_model.effects.body.com_offset import ComOffset
from spot_model.effects.body.foot_radius import FootRadius
from spot_model.effects.body.ground_compliance import GroundCompliance
from spot_model.effects.body.ground_friction import GroundFriction
from spot_model.effects.body.leg_mass import LegMass
from spot_model.effects.body.payload_mass import PayloadMass
from spot_model.effects.command.action_scale import ActionScale
from spot_model.effects.command.command_delay import CommandDelay
from spot_model.effects.command.command_drop import CommandDrop
from spot_model.effects.command.command_jitter import CommandJitter
from spot_model.effects.command.default_pose import DefaultPose
from spot_model.effects.command.joint_swap import JointSwap
from spot_model.effects.drive.armature import Armature
from spot_model.effects.drive.backlash import Backlash
from spot_model.effects.drive.coulomb_friction import CoulombFriction
from spot_model.effects.drive.joint_compliance import JointCompliance
from spot_model.effects.drive.load_friction import LoadFriction
from spot_model.effects.drive.stribeck_friction import StribeckFriction
from spot_model.effects.drive.torque_bandwidth import TorqueBandwidth
from spot_model.effects.drive.torque_gain import TorqueGain
from spot_model.effects.drive.torque_ripple import TorqueRipple
from spot_model.effects.drive.viscous_friction import ViscousFriction
from spot_model.effects.limits.bus_sag import BusSag
from spot_model.effects.limits.position_torque_limit import PositionTorqueLimit
from spot_model.effects.limits.power_limit import PowerLimit
from spot_model.effects.limits.thermal_derating import ThermalDerating
from spot_model.effects.limits.torque_limit import TorqueLimit
from spot_model.effects.limits.torque_speed_curve import TorqueSpeedCurve
from spot_model.effects.sensing.contact_delay import ContactDelay
from spot_model.effects.sensing.encoder_offset import EncoderOffset
from spot_model.effects.sensing.imu_tilt import ImuTilt
from spot_model.effects.sensing.load_sensor_gain import LoadSensorGain
from spot_model.effects.sensing.sensor_noise import SensorNoise
from spot_model.effects.sensing.velocity_estimate import VelocityEstimate
from spot_model.effects.sensing.velocity_filter import VelocityFilter
from spot_model.errors import BadInputError

ENTRY_POINT_GROUP = "spot_rl.effects"

BUILT_IN: dict[str, type[Effect]] = {
    effect.name: effect
    for effect in (
        CoulombFriction,
        TorqueLimit,
        TorqueSpeedCurve,
        PositionTorqueLimit,
        CommandDelay,
        ViscousFriction,
        StribeckFriction,
        LoadFriction,
        TorqueGain,
        Armature,
        TorqueBandwidth,
        ThermalDerating,
        TorqueRipple,
        PowerLimit,
        BusSag,
        Backlash,
        PayloadMass,
        ComOffset,
        BodyInertia,
        LegMass,
        FootRadius,
        GroundFriction,
        GroundCompliance,
        CommandJitter,
        CommandDrop,
        EncoderOffset,
        JointCompliance,
        SensorNoise,
        VelocityFilter,
        LoadSensorGain,
        VelocityEstimate,
        ImuTilt,
        ContactDelay,
        ActionScale,
        DefaultPose,
        JointSwap,
    )
}


def effect_class(name: str) -> type[Effect]:
    """The effect class called ``name``: built in, of an installed plug-in, or ``module:Class``.

    Raises:
        BadInputError: There is none, or what is there is no effect.
    """
    if name in BUILT_IN:
        return BUILT_IN[name]
    plugins = {entry.name: entry for entry in entry_points(group=ENTRY_POINT_GROUP)}
    if name in plugins:
        return _checked(name, plugins[name].load())
    if ":" in name:
        try:
            return _checked(name, pkgutil.resolve_name(name))
        except (ImportError, AttributeError, ValueError) as error:
            raise BadInputError(f"effect {name!r} cannot be loaded: {error}; check module and class name") from error
    known = ", ".join(sorted([*BUILT_IN, *plugins]))
    raise BadInputError(f"effect {name!r} is unknown; allowed: {known}, or module:Class for one of your own")


def make_effect(name: str, fields: dict[str, Any]) -> Effect:
    """Build the effect ``name`` from its parameters and joints.

    Raises:
        BadInputError: A key is not a parameter of the effect, or a value is out of bounds or no number.
    """
    cls = effect_class(name)
    allowed = [p.name for p in cls.parameters()]
    values: dict[str, Any] = {}
    for key, value in fields.items():
        if key == "joints":
            values[key] = _joint_names(name, value)
        elif key not in allowed:
            raise BadInputError(f"effect {name}: unknown key {key!r}; allowed: {', '.join(['joints', *allowed])}")
        elif isinstance(value, bool) or not isinstance(value, (int, float)):
            raise BadInputError(f"effect {name}: {key} = {value!r} is no number; allowed: a number")
        else:
            values[key] = float(value)
    return cls(**values)


def _joint_names(effect: str, value: Any) -> tuple[str, ...]:
    if isinstance(value, str):
        return (value,)
    if isinstance(value, (list, tuple)) and all(isinstance(v, str) for v in value):
        return tuple(value)
    raise BadInputError(f"effect {effect}: joints = {value!r}; allowed: a name or a list of names")


def _checked(name: str, found: Any) -> type[Effect]:
    if not (isinstance(found, type) and issubclass(found, Effect)):
        raise BadInputError(f"effect {name!r} is {found!r}; allowed: a subclass of spot_model.effects.base.Effect")
    return found
