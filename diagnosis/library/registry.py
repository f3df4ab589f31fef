"""The library: every effect that the diagnosis knows, by name."""

from __future__ import annotations

from typing import Final

from diagnosis.library.base import LibraryEffect
from diagnosis.library.effects.backlash import BacklashEntry
from diagnosis.library.effects.command_link import CommandDelayEntry, CommandDropEntry, CommandJitterEntry
from diagnosis.library.effects.drive import (
    ArmatureEntry,
    BandwidthEntry,
    DelayEntry,
    RippleEntry,
    ThermalEntry,
    TorqueGainEntry,
    TorqueOffsetEntry,
)
from diagnosis.library.effects.estimator import ContactDelayEntry, ImuTiltEntry, VelocityEstimateEntry
from diagnosis.library.effects.friction import CoulombEntry, LoadFrictionEntry, StribeckEntry, ViscousEntry
from diagnosis.library.effects.ground import FootRadiusEntry, GroundComplianceEntry, GroundFrictionEntry
from diagnosis.library.effects.joint_sensing import (
    EncoderOffsetEntry,
    JointComplianceEntry,
    LoadFilterEntry,
    LoadSensorEntry,
    SensorNoiseEntry,
    VelocityFilterEntry,
)
from diagnosis.library.effects.limits import PositionLimitEntry, SpeedCurveEntry, TorqueLimitEntry
from diagnosis.library.effects.rigid_body import ComEntry, InertiaEntry, LegMassEntry, PayloadEntry
from diagnosis.library.effects.software import ActionScaleEntry, DefaultPoseEntry, JointSwapEntry
from diagnosis.library.effects.supply import BusSagEntry, PowerLimitEntry
from diagnosis.library.effects.swinging_mass import SwingingMassEntry

LIBRARY: Final[dict[str, LibraryEffect]] = {
    entry.name: entry
    for entry in (
        CoulombEntry(),
        ViscousEntry(),
        StribeckEntry(),
        LoadFrictionEntry(),
        TorqueGainEntry(),
        TorqueLimitEntry(),
        SpeedCurveEntry(),
        PositionLimitEntry(),
        ArmatureEntry(),
        BandwidthEntry(),
        DelayEntry(),
        CommandDelayEntry(),
        CommandJitterEntry(),
        CommandDropEntry(),
        ThermalEntry(),
        TorqueOffsetEntry(),
        RippleEntry(),
        PowerLimitEntry(),
        BusSagEntry(),
        BacklashEntry(),
        JointComplianceEntry(),
        EncoderOffsetEntry(),
        LoadSensorEntry(),
        LoadFilterEntry(),
        SensorNoiseEntry(),
        VelocityFilterEntry(),
        VelocityEstimateEntry(),
        PayloadEntry(),
        SwingingMassEntry(),
        ComEntry(),
        InertiaEntry(),
        LegMassEntry(),
        FootRadiusEntry(),
        GroundFrictionEntry(),
        GroundComplianceEntry(),
        ContactDelayEntry(),
        ImuTiltEntry(),
        ActionScaleEntry(),
        DefaultPoseEntry(),
        JointSwapEntry(),
    )
}
"""40 effects. A leg that differs from the others is any of them at that leg's joints; a robot that does not follow its
commands is no effect but a cut (:mod:`diagnosis.read.segments`)."""
