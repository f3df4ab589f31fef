"""All kinds of faults that a case may ask for, by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from withheld.realities.fault_kind import BODY, JOINT_PLACES, FaultKind
from withheld.realities.faults import body, drive, friction, limits, sensing, supply, thermal, transport

_KINDS: Final = (
    FaultKind("lugre_friction", "friction", ("coulomb_friction",), JOINT_PLACES, friction.coulomb),
    FaultKind("shear_thinning_grease", "friction", ("viscous_friction",), JOINT_PLACES, friction.viscous),
    FaultKind("sticky_start", "friction", ("stribeck_friction",), JOINT_PLACES, friction.stribeck),
    FaultKind("gear_loss", "friction", ("load_friction",), JOINT_PLACES, friction.gear_loss),
    FaultKind("flux_change", "drive", ("torque_gain",), JOINT_PLACES, drive.torque_gain),
    FaultKind("heavy_rotor", "drive", ("armature",), JOINT_PLACES, drive.rotor_inertia),
    FaultKind("soft_current_limit", "limits", ("torque_limit",), JOINT_PLACES, limits.soft_limit),
    FaultKind("hot_motors", "thermal", ("thermal_derating",), JOINT_PLACES, thermal.hot_motors),
    FaultKind("bus_current_limiter", "supply", ("power_limit",), BODY, supply.bus_limit),
    FaultKind("slow_queue", "transport", ("command_delay",), BODY, transport.delay),
    FaultKind("encoder_offset", "sensing", ("encoder_offset",), ("joint",), sensing.encoder_offset),
    FaultKind("box_on_the_back", "body", ("payload_mass",), BODY, body.payload),
)

CATALOGUE: Final[Mapping[str, FaultKind]] = {kind.name: kind for kind in _KINDS}
