"""The numbers that decide what a diagnosis says, with where they come from.

Published ranges of ordinary errors come first; what follows is from physics, or from simulated robots whose faults are
known, of kinds on which the diagnosis is never judged (``benchmarks/calibrate_diagnosis.py`` and
``calibrate_formulas.py``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from diagnosis.channels import Channel


@dataclass(frozen=True)
class ErrorScale:
    """How far a nominal model is off in one effect's numbers without anything being wrong: standard deviations.

    The prior before any log is seen. What one robot's units scatter by is learned from its own logs, between
    :data:`NARROWEST` and once these.
    """

    scales: Mapping[str, float]
    """By coefficient of the library's effect."""
    alike: float = 0.4
    """Units of a type, or all of them, are off together by this share: a maker's figure is wrong for all of a kind."""
    at: Mapping[str, float] = field(default_factory=dict)
    """Shape of an effect whose size is in its shape."""
    acts_in_closed_loop: bool = True
    """Whether the robot moves otherwise with it; a load cell's error is seen and changes nothing."""


ERROR_SCALES: Final[Mapping[str, ErrorScale]] = {
    # Set-point to load differs by 5 to 20 % between joints and joint types of real legs, range; a third of it.
    "torque_gain": ErrorScale({"gain": 0.06}),
    # Zeros of Hall current sensors are specified to 0.5 to 1 % of full scale, some 50 N·m of a joint; half of it.
    "torque_offset": ErrorScale({"offset_nm": 0.2}, alike=0.3),
    # Strain-gauge cells are specified to 1 to 3 % of the reading.
    "load_sensor_gain": ErrorScale({"gain": 0.02, "bias_nm": 0.3}, alike=0.3, acts_in_closed_loop=False),
    # Joints of legged robots scatter by 0.1 to 0.3 N·m in dry friction, and by several per cent of the load.
    "coulomb_friction": ErrorScale({"level_nm": 0.15}),
    "viscous_friction": ErrorScale({"damping_nm_s_per_rad": 0.03}),
    "load_friction": ErrorScale({"share": 0.02}),
    "stribeck_friction": ErrorScale(
        {"level_nm": 0.1}, at={"speed_rad_s": 0.4, "builds_up_rad": 0.0015}, acts_in_closed_loop=False
    ),
    "armature": ErrorScale({"inertia_kg_m2": 0.006}),
    # Load cells lag by 0 to 6 ms, all of a robot by about the same.
    "load_filter": ErrorScale({"time_constant_s": 0.001}, alike=3.5, acts_in_closed_loop=False),
    # Torque loops close at some 200 Hz; in the loads alone that looks like a load cell's lag.
    "torque_bandwidth": ErrorScale({"share": 1.0}, alike=1.0, at={"time_constant_s": 0.001}, acts_in_closed_loop=False),
    "velocity_filter": ErrorScale({"time_constant_s": 0.0015}),
    "joint_compliance": ErrorScale({"compliance_rad_per_nm": 2e-4}, acts_in_closed_loop=False),
    "encoder_offset": ErrorScale({"offset_rad": 0.005}),
    # CAD masses are off by 3 to 5 %.
    "leg_mass": ErrorScale({"scale": 0.05}, alike=0.3),
    "payload_mass": ErrorScale(
        {"mass_kg": 0.5, "moment_x_kg_m": 0.15, "moment_y_kg_m": 0.1, "moment_z_kg_m": 0.15},
    ),
    "body_inertia": ErrorScale({"scale": 0.06}),
    # A worn foot loses 1 to 2 mm; soft ground looks the same, and is chosen by the closed loop itself.
    "foot_radius": ErrorScale({"change_m": 0.002}, alike=1.0, acts_in_closed_loop=False),
    "velocity_estimate": ErrorScale(
        {"scale": 0.02, "bias_x_m_s": 0.015, "bias_y_m_s": 0.015, "late": 1.0},
        at={"lag_s": 0.005},
    ),
    "imu_tilt": ErrorScale({"roll_rad": 0.008, "pitch_rad": 0.008}, at={"packets_are_tilted": 1.0}),
    # Contact detectors are late by 5 to 15 ms, and the policy never sees them.
    "contact_delay": ErrorScale({"delay_s": 0.006}, acts_in_closed_loop=False),
    # Floors: the closed loop's ground is chosen by its own distance instead.
    "ground_friction": ErrorScale({"scale": 0.2}, acts_in_closed_loop=False),
    "ground_compliance": ErrorScale({"time_constant_s": 0.003}, alike=2.0, acts_in_closed_loop=False),
    # State to command received: 4 ms in the median, 6 ms for 95 %, from published recordings.
    "command_delay": ErrorScale({"delay_s": 0.0015}),
    "command_jitter": ErrorScale({"share": 1.0}, at={"mean_s": 0.001}),
    "command_drop": ErrorScale({"probability": 0.004}, acts_in_closed_loop=False),
    "sensor_noise": ErrorScale({"position": 3.0, "velocity": 2.0, "load": 3.0}, alike=1.0, acts_in_closed_loop=False),
}
"""Published ranges of ordinary errors, by effect of the library."""
NARROWEST: Final = 0.2
"""Share of its published range that a scale learned from one robot keeps: twelve joints do not prove a robot exact."""
CLEARLY_ORDINARY: Final = 2.5
"""An error counts as ordinary up to so many of its published standard deviations: 99 in 100 lie within.

What is farther off is put back to this bound before a model "with ordinary errors alone" is compared with the robot.
"""

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

Each is at least the median of what 24 robots without a fault leave, 0 to 0.79 by channel
(``benchmarks/calibrate_formulas.py --seed 41 --robots 24``).
"""
DEGREES_OF_FREEDOM: Final = 40.0
"""Independent ways, at most, in which a formula can be off in one signal: eight phases of a gait in five strides. It
sets the scale of the evidence, to which :data:`THERE` is fitted."""
FORMULA_ERROR: Final = 0.15
"""Share of what a formula explains by which it may be off, as dry friction is from a joint with bristles (LuGre). It
sets the scale of the evidence, too."""
PARAMETER_SPREAD: Final = 0.1
"""Standard deviation of a fitted number from the formula that is not the robot's, as a share of the number: dry
friction fitted to a LuGre joint, a first-order lag to a delay."""
LEAST_NATS_TO_TRY: Final = 3.0
"""An effect that adds less than odds of 20 to 1 is not looked at; P(there) decides which of the others is named."""
MAX_EFFECTS: Final = 4
ODD_RUN: Final = 0.1
"""Share of runs in which something else went on (a rug, a push, a hot day): none tells more than log(0.9/0.1) nats."""
GROUP_ODDS: Final = 0.1
"""A rival with at least these odds against the best stays in its group."""

# ---- the gap in closed loops, in floors: distances between repeats of the robot's own runs

RUNS_APART: Final = 1.2
"""Distance in floors that even a model without any error keeps if its runs scatter as the robot's do: its few runs are
not the robot's."""
ORDINARY_LEFT_NM: Final = 2.0
"""W1 distance beyond that which models with a robot's ordinary errors alone stay under where nothing is wrong, 95 in
100: for errors of one published standard deviation (:func:`~diagnosis.selection.robot_models.size_of_errors`).

It is what such models are off by, at the policies' usual gains, and no robot's own scatter: in floors it is more for a
robot that repeats itself well (:func:`~diagnosis.verdict.probability.ordinary_gap`). From 50 faultless robots of the
calibrating catalogue's simulator, errors 0.5 to 5 times the usual, floors 0.1 to 1.2 N·m
(``benchmarks/calibrate_diagnosis.py robots --kind faultless``, seeds 311001 and 311002). 62 others, without what the
model's own runs scatter by, gave 1.9. Among 1.0 to 1.5, distances scatter least about the ordinary one with 1.2 floors
for :data:`RUNS_APART`.
"""
LARGEST_ERRORS: Final = 0.5
"""Errors of five times the usual size come out as 0.46 there: what is larger is no ordinary error, and excuses no
distance."""
USUAL_ERRORS: Final = 0.21
"""The median of the same robots. Where residuals say that more than ordinary errors is at work, the errors that were
fitted to them excuse no more than these would."""
ORDINARY_EXCESS: Final[Mapping[Channel, tuple[float, float]]] = {
    Channel.SET_POINT_TO_LOAD: (0.37, 0.59),
    Channel.LOAD_TO_MOTION: (-0.67, 0.73),
    Channel.BASE_WRENCH: (-0.81, 0.38),
    Channel.JOINT_RATES: (-0.2, 0.5),
    # A program's arithmetic is replayed to the bit, but for its rounding.
    Channel.POLICY_REPLAY: (-1.0, 0.5),
}
"""Excess of the signal that is farthest off (:func:`~diagnosis.verdict.probability.excess`), by channel: median and
standard deviation over 35 robots of the calibrating catalogue's simulator, seeds 91001 and 92001, without a fault and
with errors 0.7 to 5 times the usual, on which it hardly depends (``benchmarks/calibrate_diagnosis.py`` prints it).
Channels of forces and of the program alone: flags, stamps, noise and the battery differ between robots of one kind
without any gap, and kinematics and the inertial unit between gaits.
"""
ODD_EXCESS: Final = (3.0, 3.0)
"""At so many standard deviations above the median it is even whether a signal leaves more than ordinary errors do, one
robot in 700 for each channel; and the slope of the log odds, that of a normal density there."""
GAP_SLOPE: Final = 7.0
"""Odds of a gap rise by this power of the distance: 1.7 over the standard deviation of the logarithm of a distance over
the ordinary one on those robots, 0.24."""
LEFT_SHARE: Final = 0.25
"""Share of the distance that the right effects close which they leave, at most: their formulas are not the robot's."""
UNKNOWN: Final = (-3.2, 1.1, 0.83)
"""Log odds that something unknown matters: at the distance that is ordinary, for each e-fold of distance, for each
e-fold of nats that signals still predict.

Logistic regression over 52 diagnoses of 47 robots of the calibrating catalogue, 12 of them by a library without the
effect that moved the robot. On 76 diagnoses of 60 others, those of seed 40961 whose faults clearly matter or clearly do
not, it is right for 93 % and calls none unknown wrongly; a fit to those is (−3.15, 2.23, 0.99), right for 89 %.
All were fitted when 2.3 floors were ordinary for every robot.
"""
PRESENCE_LOG_ODDS: Final = (-2.45, 0.93)
"""Log odds that an effect is there: at one nat, and for each e-fold of nats.

Logistic regression over 98 effects that residuals of 78 robots showed, 23 of them without a fault, 44 with one and 11
with two, errors 0.5 to 5 times the usual; 49 were there (``benchmarks/calibrate_diagnosis.py``, seed 8801). Robots with
a fault outside the library are left out, because P(unknown) covers them; with 11 of these, and 116 effects, the fit is
(-2.10, 0.65).
"""
USUAL_LEFT: Final[Mapping[str, float]] = {
    Channel.SET_POINT_TO_LOAD: 9.0,
    Channel.BASE_WRENCH: 7.0,
    Channel.CONTACT_EVENTS: 8.0,
    Channel.LOAD_TO_MOTION: 14.0,
    Channel.INERTIAL_UNIT: 6.0,
    Channel.STANCE_KINEMATICS: 2.0,
    Channel.POLICY_REPLAY: 1.0,
    Channel.SENSOR_NOISE: 12.0,
    Channel.BATTERY_POWER: 1.0,
    Channel.JOINT_RATES: 2.0,
    Channel.TIME_STAMPS: 1.0,
}
"""Nats that trees still predict, by channel, of what is left where nothing is wrong. Not calibrated."""

NAMED: Final = 0.5
"""What is more probable than not is named."""
