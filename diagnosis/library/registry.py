"""The library: every effect that the diagnosis knows, by name."""

from __future__ import annotations

from typing import Final

from diagnosis.library.base import LibraryEffect
from diagnosis.library.drive import ArmatureEntry, BandwidthEntry, RippleEntry, ThermalEntry, TorqueGainEntry
from diagnosis.library.estimator import ContactDelayEntry, ImuTiltEntry, VelocityEstimateEntry
from diagnosis.library.friction import CoulombEntry, LoadFrictionEntry, StribeckEntry, ViscousEntry
from diagnosis.library.gap import BacklashEntry
from diagnosis.library.ground import FootRadiusEntry, GroundComplianceEntry, GroundFrictionEntry
from diagnosis.library.joint_sensing import (
    EncoderOffsetEntry,
    JointComplianceEntry,
    LoadSensorEntry,
    SensorNoiseEntry,
    VelocityFilterEntry,
)
from diagnosis.library.limits import PositionLimitEntry, SpeedCurveEntry, TorqueLimitEntry
from diagnosis.library.link import CommandDelayEntry, CommandDropEntry, CommandJitterEntry
from diagnosis.library.rigid_body import ComEntry, InertiaEntry, LegMassEntry, PayloadEntry
from diagnosis.library.software import ActionScaleEntry, DefaultPoseEntry, JointSwapEntry
from diagnosis.library.supply import BusSagEntry, PowerLimitEntry

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
        CommandDelayEntry(),
        CommandJitterEntry(),
        CommandDropEntry(),
        ThermalEntry(),
        RippleEntry(),
        PowerLimitEntry(),
        BusSagEntry(),
        BacklashEntry(),
        JointComplianceEntry(),
        EncoderOffsetEntry(),
        LoadSensorEntry(),
        SensorNoiseEntry(),
        VelocityFilterEntry(),
        VelocityEstimateEntry(),
        PayloadEntry(),
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
"""36 effects. A leg that differs from the others is any of them at that leg's joints; a robot that does not follow its
commands is no effect but a cut (:mod:`diagnosis.segments`)."""
