"""Facts about Spot; every number has a source.

Sources: [sdk] Boston Dynamics' SDK 5.2.0, its documents and model; [isaac] Isaac Lab's public Spot asset (BSD-3);
[paper] Miller et al. 2025, "High-Performance Reinforcement Learning on Spot"; [judo] judo's public Spot model (MIT);
[log] a published recording of a real Spot's state stream. Derived numbers are derived here, in code.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

NS_PER_S: Final = 1_000_000_000
"""Stamps are integers of nanoseconds; durations are floats of seconds."""

Array = NDArray[np.float64]

LEG_NAMES: Final = ("fl", "fr", "hl", "hr")
"""Legs in the SDK's order: front or hind, left or right. [sdk]"""

JOINT_TYPES: Final = ("hx", "hy", "kn")
"""Hip abduction, hip flexion, knee. [sdk]"""

JOINT_NAMES: Final = tuple(f"{leg}_{joint}" for leg in LEG_NAMES for joint in JOINT_TYPES)
"""The one canonical joint order of this project: the SDK's. [sdk]"""

BREADTH_FIRST: Final = tuple(f"{leg}_{joint}" for joint in JOINT_TYPES for leg in LEG_NAMES)
"""The order of Isaac Lab and most simulators: all hx, all hy, all kn, each fl, fr, hl, hr."""

N_JOINTS: Final = len(JOINT_NAMES)
N_LEGS: Final = len(LEG_NAMES)


def side_sign(leg: str) -> int:
    """+1 for a left leg, −1 for a right leg."""
    return 1 if leg.endswith("l") else -1


def end_sign(leg: str) -> int:
    """+1 for a front leg, −1 for a hind leg."""
    return 1 if leg.startswith("f") else -1


def per_joint(hx: float, hy: float, kn: float) -> Array:
    """Repeat one value a joint type over the four legs. Returns shape (12,), canonical order."""
    return np.tile(np.array([hx, hy, kn], dtype=np.float64), N_LEGS)


# Pose and limits -----------------------------------------------------------------------------------------------------

DEFAULT_POSITION_RAD: Final[Array] = np.array(
    [v for leg in LEG_NAMES for v in (0.1 * side_sign(leg), 0.9 if end_sign(leg) > 0 else 1.1, -1.5)]
)
"""Default joint pose, shape (12,). [isaac]"""

POSITION_LOW_RAD: Final[Array] = per_joint(-0.785398, -0.898845, -2.7929)
POSITION_HIGH_RAD: Final[Array] = per_joint(0.785398, 2.295108, -0.2471)
"""Joint stops, shape (12,). [sdk]"""

HIP_TORQUE_LIMIT_NM: Final = 45.0
"""Flat limit of both hip joints, N·m; gear 51 × 0.88 N·m = 44.88. [sdk, isaac]"""

ROTOR_INERTIA_KG_M2: Final = 1.55e-5
HIP_GEAR_RATIO: Final = 51.0
HIP_ARMATURE_KG_M2: Final = ROTOR_INERTIA_KG_M2 * HIP_GEAR_RATIO**2
KNEE_ARMATURE_KG_M2: Final = 0.0731
"""Reflected rotor inertia, one public estimate [judo]; the paper did not identify it, so the nominal model has none."""

# Masses and geometry [sdk] -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class LinkInertia:
    """Mass (kg), centre of mass (m, link frame) and inertia about it (kg·m²) as xx, yy, zz, xy, xz, yz."""

    mass_kg: float
    com_m: tuple[float, float, float]
    inertia_kg_m2: tuple[float, float, float, float, float, float]

    def mirrored(self, *, left_right: bool = False, front_hind: bool = False) -> LinkInertia:
        """The same link on the other side (y → −y) and/or the other end (x → −x) of the robot."""
        sx, sy = (-1.0 if front_hind else 1.0), (-1.0 if left_right else 1.0)
        x, y, z = self.com_m
        xx, yy, zz, xy, xz, yz = self.inertia_kg_m2
        return LinkInertia(self.mass_kg, (sx * x, sy * y, z), (xx, yy, zz, sx * sy * xy, sx * xz, sy * yz))


BODY: Final = LinkInertia(16.70765, (0.0, 0.0, -0.00496), (0.08154, 0.54923, 0.56945, 0.0, 0.0, 0.0))
HIP_FL: Final = LinkInertia(
    1.13688, (-0.01586739, 0.00855842, 0.00000903), (0.00122166, 0.00158957, 0.00172903, -0.00017754, 0.0, 0.0)
)
UPPER_LEG_FL: Final = LinkInertia(
    2.25620,
    (0.00214442, -0.01110184, -0.07881204),
    (0.02692501, 0.02583907, 0.00318737, -0.00008782, 0.00054873, 0.00207146),
)
LOWER_LEG_FL: Final = LinkInertia(
    0.33, (0.0059736, 0.0, -0.17466427), (0.00701356, 0.00709946, 0.00014529, 0.0, 0.000066, 0.0)
)
TOTAL_MASS_KG: Final = BODY.mass_kg + N_LEGS * (HIP_FL.mass_kg + UPPER_LEG_FL.mass_kg + LOWER_LEG_FL.mass_kg)
"""31.60 kg without an arm (the data sheet says 32.5). The public MuJoCo models' 50.3 kg is 55 % too much."""

HX_FROM_BODY_M: Final = (0.29785, 0.055, 0.0)
HY_FROM_HX_M: Final = (0.0, 0.110945, 0.0)
KN_FROM_HY_M: Final = (0.025, 0.0, -0.3205)
"""Joint placements of the front-left leg, m; signs of x (hx only) and y follow the leg. [sdk]"""

FOOT_FROM_KN_M: Final = (0.0, 0.0, -0.3365)
FOOT_RADIUS_M: Final = 0.036
"""Foot sphere on the lower leg. [public models]"""

# Control -------------------------------------------------------------------------------------------------------------

POLICY_KP_NM_PER_RAD: Final = 60.0
POLICY_KD_NM_S_PER_RAD: Final = 1.5
ACTION_SCALE_RAD: Final = 0.2
POLICY_RATE_HZ: Final = 50.0
TRAINING_COMMAND_DELAY_S: Final = 0.005
"""Gains, action scale and rates of the paper's policy. [paper]"""

STAND_KP_NM_PER_RAD: Final[Array] = per_joint(624.0, 936.0, 286.0)
STAND_KD_NM_S_PER_RAD: Final[Array] = per_joint(5.20, 5.20, 2.04)
"""Gains of the vendor's own stand, shape (12,). [sdk]"""

# Streams -------------------------------------------------------------------------------------------------------------

STATE_PERIOD_NS: Final = 3_000_000
"""Period of the state stream in robot time: exactly 3 ms. [log]"""

ROBOT_CLOCK_SKEW_S: Final = -199.19
"""Robot clock minus client clock in the published recording. [log]"""


# The paper's model ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PaperActuator:
    """The eight actuator parameters that the paper identifies; its table of optimised parameters."""

    hip_friction_nm: float
    knee_friction_nm: float
    torque_max_nm: float
    torque_min_nm: float
    speed_max_rad_s: float
    speed_min_rad_s: float
    intersect_max_rad_s: float
    intersect_min_rad_s: float


PAPER_IDENTIFIED: Final = PaperActuator(0.008, 0.180, 97.00, -108.79, 25.03, -22.22, 9.48, -8.32)
PAPER_INITIAL: Final = PaperActuator(0.0, 0.0, 70.0, -70.0, 20.0, -20.0, 0.0, 0.0)


KNEE_MOTOR_TORQUE_NM: Final = 1.5

_TABLE: Final = np.loadtxt(Path(__file__).with_name("knee_transmission.csv"), delimiter=",", skiprows=1).T.copy()

KNEE_TABLE_POSITION_RAD: Final[NDArray[np.float64]] = _TABLE[0]
"""Knee angles of the table, shape (101,), rising and evenly spaced, rad."""

KNEE_TABLE_RATIO: Final[NDArray[np.float64]] = _TABLE[1]
"""Transmission ratio, motor to joint, shape (101,); negative by the sense of rotation."""

KNEE_TABLE_TORQUE_NM: Final[NDArray[np.float64]] = KNEE_MOTOR_TORQUE_NM * np.abs(KNEE_TABLE_RATIO)
"""Torque limit at each angle, shape (101,), N·m."""
