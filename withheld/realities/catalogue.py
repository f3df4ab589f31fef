"""All kinds of faults that a case may ask for, by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from spot_model.robot.facts import JOINT_NAMES
from withheld.realities.fault_kind import BODY, JOINT_PLACES, LEG_PLACES, FaultKind
from withheld.realities.faults import (
    body,
    drive,
    estimator,
    friction,
    ground,
    learned,
    limits,
    sensing,
    software,
    strange,
    strange_body,
    supply,
    thermal,
    transport,
)

_KNEES: Final = tuple(j for j in JOINT_NAMES if j.endswith("kn"))
_HIPS: Final = tuple(j for j in JOINT_NAMES if not j.endswith("kn"))
_LEGS: Final = tuple(j for j in JOINT_NAMES if not j.endswith("hx"))

_KINDS: Final = (
    FaultKind("lugre_friction", "friction", ("coulomb_friction",), JOINT_PLACES, friction.coulomb),
    FaultKind("shear_thinning_grease", "friction", ("viscous_friction",), JOINT_PLACES, friction.viscous),
    FaultKind("sticky_start", "friction", ("stribeck_friction",), JOINT_PLACES, friction.stribeck),
    FaultKind("gear_loss", "friction", ("load_friction",), JOINT_PLACES, friction.gear_loss),
    FaultKind("flux_change", "drive", ("torque_gain",), JOINT_PLACES, drive.torque_gain),
    FaultKind("heavy_rotor", "drive", ("armature",), JOINT_PLACES, drive.rotor_inertia),
    FaultKind("slow_current_loop", "drive", ("torque_bandwidth",), JOINT_PLACES, drive.slow_loop),
    FaultKind("tooth_ripple", "drive", ("torque_ripple",), JOINT_PLACES, drive.ripple),
    FaultKind("loose_teeth", "drive", ("backlash",), JOINT_PLACES, drive.play),
    FaultKind("soft_gear", "drive", ("joint_compliance",), JOINT_PLACES, drive.soft_gear),
    FaultKind("servo_gains", "drive", ("torque_gain",), JOINT_PLACES, drive.servo_gains),
    FaultKind("servo_damping", "drive", ("viscous_friction",), JOINT_PLACES, drive.servo_damping),
    FaultKind("soft_current_limit", "limits", ("torque_limit",), JOINT_PLACES, limits.soft_limit),
    FaultKind("weak_lever", "limits", ("position_torque_limit",), ("joint", "type"), limits.weak_lever, _KNEES),
    FaultKind("few_volts", "limits", ("torque_speed_curve",), ("joint", "type"), limits.few_volts, _LEGS),
    FaultKind("hot_motors", "thermal", ("thermal_derating",), JOINT_PLACES, thermal.hot_motors),
    FaultKind("bus_current_limiter", "supply", ("power_limit",), BODY, supply.bus_limit),
    FaultKind("tired_battery", "supply", ("bus_sag", "torque_speed_curve"), BODY, supply.tired_battery),
    FaultKind("slow_queue", "transport", ("command_delay",), BODY, transport.delay),
    FaultKind("stuttering_link", "transport", ("command_jitter",), BODY, transport.jitter),
    FaultKind("lossy_link", "transport", ("command_drop",), BODY, transport.losses),
    FaultKind("encoder_offset", "sensing", ("encoder_offset",), ("joint",), sensing.encoder_offset),
    FaultKind("worn_load_cell", "sensing", ("load_sensor_gain",), ("joint", "type", "leg"), sensing.load_cell),
    FaultKind("noisy_sensors", "sensing", ("sensor_noise",), JOINT_PLACES, sensing.noise),
    FaultKind("filtered_rates", "sensing", ("velocity_filter",), ("type", "leg", "all"), sensing.rate_filter),
    FaultKind("late_contacts", "sensing", ("contact_delay",), LEG_PLACES, sensing.late_contacts),
    FaultKind("crooked_imu", "sensing", ("imu_tilt",), BODY, sensing.crooked_imu),
    FaultKind("wrong_odometry", "estimator", ("velocity_estimate",), BODY, estimator.wrong_lengths),
    FaultKind("lazy_estimator", "estimator", ("velocity_estimate",), BODY, estimator.lazy),
    FaultKind("box_on_the_back", "body", ("payload_mass",), BODY, body.payload),
    FaultKind("moved_ballast", "body", ("com_offset",), BODY, body.ballast),
    FaultKind("dumbbells", "body", ("body_inertia",), BODY, body.dumbbells),
    FaultKind("boots", "body", ("leg_mass",), ("type", "leg", "all"), body.boots),
    FaultKind("worn_feet", "body", ("foot_radius",), LEG_PLACES, body.worn_feet),
    FaultKind("slippery_ground", "ground", ("ground_friction",), LEG_PLACES, ground.slippery),
    FaultKind("soft_ground", "ground", ("ground_compliance",), LEG_PLACES, ground.soft),
    FaultKind("wrong_action_scale", "software", ("action_scale",), ("type", "all"), software.action_scale),
    FaultKind("wrong_pose", "software", ("default_pose",), ("joint", "type"), software.default_pose),
    FaultKind("mixed_sides", "software", ("joint_swap",), ("type",), software.mixed_sides),
    FaultKind("bent_shaft", "friction", (), JOINT_PLACES, strange.bent_shaft),
    FaultKind("sticky_bearing", "friction", (), JOINT_PLACES, strange.sticky_bearing),
    FaultKind("reversal_sag", "drive", (), JOINT_PLACES, strange.reversal_sag),
    FaultKind("lopsided_motor", "drive", (), JOINT_PLACES, strange.lopsided),
    FaultKind("crosstalk", "drive", (), ("leg", "all"), strange.crosstalk, _LEGS),
    FaultKind("slow_encoder", "sensing", (), JOINT_PLACES, strange.slow_encoder),
    FaultKind("cable_bundle", "body", (), ("leg", "all"), strange_body.cable_bundle, _HIPS),
    FaultKind("rubber_sleeve", "body", (), ("joint", "type", "all"), strange_body.hysteretic_spring, _KNEES),
    FaultKind("rubbing_stop", "body", (), ("joint", "type"), strange_body.rubbing_stop),
    FaultKind("headwind", "body", (), BODY, strange_body.headwind),
    FaultKind("sloshing_tank", "body", (), BODY, strange_body.slosh),
    FaultKind("learned_drive", "learned", (), JOINT_PLACES, learned.learned_drive),
)

CATALOGUE: Final[Mapping[str, FaultKind]] = {kind.name: kind for kind in _KINDS}
