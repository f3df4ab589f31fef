"""The library: every effect that the diagnosis knows, by name."""

from __future__ import annotations

from typing import Final

from diagnosis.library.base import LibraryEffect
from diagnosis.library.effects import (
    command_link,
    drive,
    estimator,
    friction,
    ground,
    joint_sensing,
    limits,
    rigid_body,
    software,
)

LIBRARY: Final[dict[str, LibraryEffect]] = {
    entry.name: entry
    for entry in (
        friction.CoulombEntry(),
        friction.ViscousEntry(),
        friction.StribeckEntry(),
        friction.LoadFrictionEntry(),
        drive.TorqueGainEntry(),
        limits.TorqueLimitEntry(),
        limits.SpeedCurveEntry(),
        limits.PositionLimitEntry(),
        drive.ArmatureEntry(),
        drive.BandwidthEntry(),
        drive.DelayEntry(),
        command_link.CommandDelayEntry(),
        command_link.CommandJitterEntry(),
        command_link.CommandDropEntry(),
        drive.ThermalEntry(),
        drive.TorqueOffsetEntry(),
        drive.RippleEntry(),
        limits.PowerLimitEntry(),
        limits.BusSagEntry(),
        drive.BacklashEntry(),
        joint_sensing.JointComplianceEntry(),
        joint_sensing.EncoderOffsetEntry(),
        joint_sensing.LoadSensorEntry(),
        joint_sensing.LoadFilterEntry(),
        joint_sensing.SensorNoiseEntry(),
        joint_sensing.VelocityFilterEntry(),
        estimator.VelocityEstimateEntry(),
        rigid_body.PayloadEntry(),
        rigid_body.SwingingMassEntry(),
        rigid_body.ComEntry(),
        rigid_body.InertiaEntry(),
        rigid_body.LegMassEntry(),
        ground.FootRadiusEntry(),
        ground.GroundFrictionEntry(),
        ground.GroundComplianceEntry(),
        estimator.ContactDelayEntry(),
        estimator.ImuTiltEntry(),
        software.ActionScaleEntry(),
        software.DefaultPoseEntry(),
        software.JointSwapEntry(),
    )
}
"""40 effects. A leg that differs from the others is any of them at that leg's joints; a robot that does not follow its
commands is no effect but a cut (:mod:`diagnosis.read.segments`)."""
