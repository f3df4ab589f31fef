"""The numbers that decide what a diagnosis says, with where they come from.

Published ranges of ordinary errors come first; what follows is from physics, or from simulated robots whose faults are
known, of kinds on which the diagnosis is never judged (``lab/benchmarks/calibrate_diagnosis.py``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from diagnosis.channels import Channel


@dataclass(frozen=True)
class ErrorScale:
    """How far a nominal model is off in one effect's numbers without anything being wrong: standard deviations.

    The ordinary part of each number's prior; the other part is its realistic range.
    """

    scales: Mapping[str, float]
    """By coefficient of the library's effect."""
    alike: float = 0.4
    """Units of a type, or all of them, are off together by this share: a maker's figure is wrong for all of a kind."""
    at: Mapping[str, float] = field(default_factory=dict)
    """Shape of an effect whose size is in its shape."""


ERROR_SCALES: Final[Mapping[str, ErrorScale]] = {
    # Set-point to load differs by 5 to 20 % between joints and joint types of real legs, range; a third of it.
    "torque_gain": ErrorScale({"gain": 0.06}),
    # Zeros of Hall current sensors are specified to 0.5 to 1 % of full scale, some 50 N·m of a joint; half of it.
    "torque_offset": ErrorScale({"offset_nm": 0.2}, alike=0.3),
    # Strain-gauge cells are specified to 1 to 3 % of the reading.
    "load_sensor_gain": ErrorScale({"gain": 0.02, "bias_nm": 0.3}, alike=0.3),
    # Joints of legged robots scatter by 0.1 to 0.3 N·m in dry friction, and by several per cent of the load.
    "coulomb_friction": ErrorScale({"level_nm": 0.15}),
    "viscous_friction": ErrorScale({"damping_nm_s_per_rad": 0.03}),
    "load_friction": ErrorScale({"share": 0.02}),
    "stribeck_friction": ErrorScale({"level_nm": 0.1}, at={"speed_rad_s": 0.4, "builds_up_rad": 0.0015}),
    "armature": ErrorScale({"inertia_kg_m2": 0.006}),
    # Load cells lag by 0 to 6 ms, all of a robot by about the same.
    "load_filter": ErrorScale({"time_constant_s": 0.001}, alike=3.5),
    # Torque loops close at some 200 Hz; in the loads alone that looks like a load cell's lag.
    "torque_bandwidth": ErrorScale({"share": 1.0}, alike=1.0, at={"time_constant_s": 0.001}),
    "velocity_filter": ErrorScale({"time_constant_s": 0.0015}),
    "joint_compliance": ErrorScale({"compliance_rad_per_nm": 2e-4}),
    "encoder_offset": ErrorScale({"offset_rad": 0.005}),
    # CAD masses are off by 3 to 5 %.
    "leg_mass": ErrorScale({"scale": 0.05}, alike=0.3),
    "payload_mass": ErrorScale({"mass_kg": 0.5, "moment_x_kg_m": 0.15, "moment_y_kg_m": 0.1, "moment_z_kg_m": 0.15}),
    "body_inertia": ErrorScale({"scale": 0.06}),
    # A worn foot loses 1 to 2 mm; soft ground looks the same, and is chosen by the closed loop itself.
    "foot_radius": ErrorScale({"change_m": 0.002}, alike=1.0),
    "velocity_estimate": ErrorScale(
        {"scale": 0.02, "bias_x_m_s": 0.015, "bias_y_m_s": 0.015, "late": 1.0}, at={"lag_s": 0.005}
    ),
    "imu_tilt": ErrorScale({"roll_rad": 0.008, "pitch_rad": 0.008}, at={"packets_are_tilted": 1.0}),
    # Paved ground falls by 1 to 2 % for drainage, screed by less.
    "ground_slope": ErrorScale({"rise_x_rad": 0.01, "rise_y_rad": 0.01}, at={"stretch_s": 0.0}),
    # Contact detectors are late by 5 to 15 ms, and the policy never sees them.
    "contact_delay": ErrorScale({"delay_s": 0.006}),
    # Floors: the closed loop's ground is chosen by its own distance instead.
    "ground_friction": ErrorScale({"scale": 0.2}),
    "ground_compliance": ErrorScale({"time_constant_s": 0.003}, alike=2.0),
    # State to command received: 4 ms in the median, 6 ms for 95 %, from published recordings.
    "command_delay": ErrorScale({"delay_s": 0.0015}),
    "command_jitter": ErrorScale({"share": 1.0}, at={"mean_s": 0.001}),
    "command_drop": ErrorScale({"probability": 0.004}),
    "sensor_noise": ErrorScale({"position": 3.0, "velocity": 2.0, "load": 3.0}, alike=1.0),
}
"""Published ranges of ordinary errors, by effect of the library."""
CLEARLY_ORDINARY: Final = 2.5
"""An error counts as ordinary up to so many of its published standard deviations: 99 in 100 lie within."""

# ---- before anything is seen

OUTSIDE: Final = 0.15
"""Share of robots brought to a diagnosis whose fault the library lacks, before anything is seen: its 40 effects are
those that publications describe."""
ODD: Final = 0.01
"""Share of numbers that are out of the ordinary, before anything is seen: with some eighty of them, one on most robots
that are brought to a diagnosis."""
LARGEST_IN_SPREADS: Final = 10.0
"""Largest realistic size in published spreads, where an entry names none: half the torque lost, 2 N·m of friction or
of a zero, 5 kg, 3 degrees of an encoder."""

# ---- evidence in the residuals

DISCREPANCY: Final[Mapping[str, float]] = {
    Channel.SET_POINT_TO_LOAD: 0.7,
    Channel.BASE_WRENCH: 1.2,
    Channel.CONTACT_EVENTS: 0.7,
    Channel.LOAD_TO_MOTION: 2.0,
    Channel.INERTIAL_UNIT: 1.5,
    Channel.STANCE_KINEMATICS: 0.7,
    Channel.POLICY_REPLAY: 2.0,
    Channel.SENSOR_NOISE: 1.0,
    Channel.BATTERY_POWER: 2.0,
    Channel.JOINT_RATES: 0.5,
    Channel.TIME_STAMPS: 1.0,
}
"""What formulas leave in a channel, root mean square in units of its noise, so that a small misfit is no finding.

Each is at least the median of what 24 robots without a fault leave, 0 to 0.79 by channel (seed 41, at
revision 07f8cd78).
"""
DEGREES_OF_FREEDOM: Final = 40.0
"""Independent ways, at most, in which a formula can be off in one signal: eight phases of a gait in five strides. It
sets the scale of the evidence."""
FORMULA_ERROR: Final = 0.15
"""Share of what a formula explains by which it may be off, as dry friction is from a joint with bristles (LuGre). It
sets the scale of the evidence, too."""
PARAMETER_SPREAD: Final = 0.1
"""Standard deviation of a fitted number from the formula that is not the robot's, as a share of the number: dry
friction fitted to a LuGre joint, a first-order lag to a delay."""
ODD_RUN: Final = 0.1
"""Share of runs in which something else went on (a rug, a push, a hot day): none tells more than log(0.9/0.1) nats."""
GROUP_ODDS: Final = 0.1
"""A rival with at least these odds against the best stays in its group."""
LEAST_NATS: Final = 3.0
"""What brings less than odds of 20 to 1 is no finding, however little faultless robots show of it."""
TAUGHT: Final = 0.5
"""Share of the published variance that a number's variance stays under, if the logs say at least as much of it as the
publications do."""

# ---- the gap in closed loops, in floors: distances between repeats of the robot's own runs

RUNS_APART: Final = 1.2
"""Distance in floors that even a model without any error keeps if its runs scatter as the robot's do: its few runs are
not the robot's. Among 1.0 to 1.5, the distances of 50 robots without a fault (calibrating catalogue, seeds 311001 and
311002) scatter least about their ordinary one with it."""
PRACTICAL: Final = 0.02
"""Share of a signal's own spread under which a distance is nothing to anybody, however well a robot repeats itself."""
MIN_GAP: Final = 0.05
"""A gap that exceeds its floor by less than this share of the floor has nothing to shrink."""
SIGNIFICANT: Final = 0.05
"""Largest p value, corrected for the number of cells or of dated numbers, that is not taken for chance."""
NAMED: Final = 0.5
"""What is more probable than not is named."""
