"""Kinds on which anything may be calibrated, by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from withheld.realities.calibrating import body, drive, friction, limits, outside, sensing, supply, transport
from withheld.realities.fault_kind import BODY, JOINT_PLACES, LEG_PLACES, FaultKind

_KINDS: Final = (
    FaultKind("lugre_friction", "friction", ("coulomb_friction",), JOINT_PLACES, friction.coulomb),
    FaultKind("shear_thinning_grease", "friction", ("viscous_friction",), JOINT_PLACES, friction.viscous),
    FaultKind("sticky_start", "friction", ("stribeck_friction",), JOINT_PLACES, friction.stribeck),
    FaultKind("gear_loss", "friction", ("load_friction",), JOINT_PLACES, friction.gear_loss),
    FaultKind("flux_change", "drive", ("torque_gain",), JOINT_PLACES, drive.torque_gain),
    FaultKind("slow_current_loop", "drive", ("torque_bandwidth",), JOINT_PLACES, drive.slow_loop),
    FaultKind("loose_teeth", "drive", ("backlash",), JOINT_PLACES, drive.play),
    FaultKind("servo_gains", "drive", ("torque_gain",), JOINT_PLACES, drive.servo_gains),
    FaultKind("servo_damping", "drive", ("viscous_friction",), JOINT_PLACES, drive.servo_damping),
    FaultKind("soft_current_limit", "limits", ("torque_limit",), JOINT_PLACES, limits.soft_limit),
    FaultKind("hot_motors", "thermal", ("thermal_derating",), JOINT_PLACES, limits.hot_motors),
    FaultKind("bus_current_limiter", "supply", ("power_limit",), BODY, supply.bus_limit),
    FaultKind("tired_battery", "supply", ("bus_sag", "torque_speed_curve"), BODY, supply.tired_battery),
    FaultKind("slow_queue", "transport", ("command_delay",), BODY, transport.delay),
    FaultKind("stuttering_link", "transport", ("command_jitter",), BODY, transport.jitter),
    FaultKind("lossy_link", "transport", ("command_drop",), BODY, transport.losses),
    FaultKind("encoder_offset", "sensing", ("encoder_offset",), ("joint",), sensing.encoder_offset),
    FaultKind("noisy_sensors", "sensing", ("sensor_noise",), JOINT_PLACES, sensing.noise),
    FaultKind("crooked_imu", "sensing", ("imu_tilt",), BODY, sensing.crooked_imu),
    FaultKind("lazy_estimator", "estimator", ("velocity_estimate",), BODY, sensing.lazy),
    FaultKind("box_on_the_back", "body", ("payload_mass",), BODY, body.payload),
    FaultKind("boots", "body", ("leg_mass",), ("type", "leg", "all"), body.boots),
    FaultKind("slippery_ground", "ground", ("ground_friction",), LEG_PLACES, body.slippery),
    FaultKind("soft_ground", "ground", ("ground_compliance",), LEG_PLACES, body.soft),
    *outside.KINDS,
)

CATALOGUE: Final[Mapping[str, FaultKind]] = {kind.name: kind for kind in _KINDS}
