"""Spot's arm: its seven joints, links and stowed pose; and what it weighs and where, as one rigid body.

Sources: [sdk] Boston Dynamics' SDK 5.1.4: ``spot_constants.proto`` (order), ``files/spot_with_arm_urdf.zip`` (links,
limits), ``python/examples/joint_control/constants.py`` (gains); [eesc] EESC-LabRoM/spot-rl-example, which walks a real
Spot with these set-points for its stowed arm.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from spot_model.robot.facts import Array, LinkInertia

ARM_JOINT_NAMES: Final = ("arm0_sh0", "arm0_sh1", "arm0_el0", "arm0_el1", "arm0_wr0", "arm0_wr1", "arm0_f1x")
"""Shoulder, shoulder, elbow, elbow, wrist, wrist, gripper, behind the legs' twelve in every array. [sdk]"""

N_ARM_JOINTS: Final = len(ARM_JOINT_NAMES)

ARM_LINK_NAMES: Final = ("link_sh0", "link_sh1", "link_el0", "link_el1", "link_wr0", "link_wr1", "link_fngr")
"""The link that each joint moves; with ``arm0.`` before it, its name in the vendor's model. [sdk]"""

ARM_LOW_RAD: Final[Array] = np.array([-2.61799, -3.14159, 0.0, -2.79253, -1.8326, -2.87989, -1.5708])
ARM_HIGH_RAD: Final[Array] = np.array([3.14159, 0.523599, 3.14159, 2.79253, 1.8326, 2.87979, 0.0])
"""Joint stops, shape (7,); a gripper at 0 is closed. [sdk]"""

ARM_TORQUE_LIMIT_NM: Final[Array] = np.array([90.9, 181.8, 90.9, 30.3, 30.3, 30.3, 15.32])
"""Shape (7,). [sdk]"""

ARM_KP_NM_PER_RAD: Final[Array] = np.array([1020.0, 255.0, 204.0, 102.0, 102.0, 102.0, 16.0])
ARM_KD_NM_S_PER_RAD: Final[Array] = np.array([10.2, 15.3, 10.2, 2.04, 2.04, 2.04, 0.32])
"""The vendor's published gains of position control, shape (7,). [sdk]"""

STOWED_RAD: Final[Array] = np.array([0.0, -3.1415, 3.1415, 1.5655, 0.0, -1.5655, 0.0])
"""The arm folded over the back, the gripper closed, shape (7,). [eesc]"""

STOWED_LOW_RAD: Final[Array] = np.array([-0.4, -3.3, 2.8, -3.0, -0.6, -3.0, -0.15])
STOWED_HIGH_RAD: Final[Array] = np.array([0.4, -2.8, 3.3, 3.0, 0.6, 3.0, 0.15])
"""Poses that count as stowed, shape (7,): shoulder and elbow folded, the wrist along the forearm, whichever way it is
rolled, the gripper closed. Our own bounds, 0.3 rad and more around published poses; with them the hand moves by 0.15 m.
"""

ARM_AXES: Final = ((0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0))
ARM_PLACES_M: Final = (
    (0.292, 0.0, 0.188), (0.0, 0.0, 0.0), (0.3385, 0.0, 0.0), (0.4033, 0.0, 0.075),
    (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.11745, 0.0, 0.01482),
)  # fmt: skip
"""Axis of each joint, and where it is in the frame of the link before it; the first in the body's. [sdk]"""

ARM_LINKS: Final = (
    LinkInertia(1.904699, (-0.008399, 0.000272, -0.024603), (0.008896, 0.004922, 0.007303, 5e-06, -0.000193, 3.3e-05)),
    LinkInertia(1.857019, (0.080849, -0.001672, 0.000456), (0.002615, 0.027039, 0.028199, -0.000404, 0.0001, 5e-06)),
    LinkInertia(0.94832, (0.044766, -0.002711, 0.049914), (0.001759, 0.002692, 0.002029, 6.1e-05, 0.000924, 5.2e-05)),
    LinkInertia(1.017548, (-0.168671, -0.016161, 1.1e-05), (0.001177, 0.016494, 0.016899, -0.002605, 2e-06, -3e-06)),
    LinkInertia(0.582637, (0.009525, -0.011444, 2e-06), (0.000467, 0.00045, 0.000536, 7e-05, 0.0, 0.0)),
    LinkInertia(0.933353, (0.097513, 9.3e-05, -0.011205), (0.000988, 0.00197, 0.001658, -1e-06, -0.000369, -1e-06)),
    LinkInertia(0.223833, (0.035652, 0.000672, -0.012275), (0.000252, 0.000485, 0.000591, -5e-06, -0.000151, 2e-06)),
)
ARM_MASS_KG: Final = sum(link.mass_kg for link in ARM_LINKS)
"""7.47 kg, where the data sheet has 8 kg with the gripper. [sdk]"""


HAND_FROM_WRIST_M: Final = (0.19557, 0.0, 0.0)
"""The hand's frame in that of the last wrist link, turned as it is. [sdk]"""


def arm_frames(position_rad: Array) -> list[tuple[Array, Array]]:
    """Rotation (3, 3) and origin (3,) of each of the arm's links in the body's frame, at these angles, shape (7,)."""
    frames, rotation, origin = [], np.eye(3), np.zeros(3)
    for angle, axis, place in zip(position_rad, ARM_AXES, ARM_PLACES_M, strict=True):
        origin = origin + rotation @ np.array(place)
        cross = np.cross(np.eye(3), np.array(axis, dtype=float))
        rotation = rotation @ (np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)
        frames.append((rotation, origin))
    return frames


def arm_as_one_body(position_rad: Array) -> LinkInertia:
    """The arm at these joint angles, shape (7,), as one rigid body in the body's frame."""
    parts = list(zip(ARM_LINKS, arm_frames(position_rad), strict=True))
    centres = [origin + rotation @ np.array(link.com_m) for link, (rotation, origin) in parts]
    com = sum((link.mass_kg * c for link, c in zip(ARM_LINKS, centres, strict=True)), np.zeros(3)) / ARM_MASS_KG
    inertia = np.zeros((3, 3))
    for (link, (rotation, _)), centre in zip(parts, centres, strict=True):
        xx, yy, zz, xy, xz, yz = link.inertia_kg_m2
        own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        off = centre - com
        inertia += rotation @ own @ rotation.T + link.mass_kg * (off @ off * np.eye(3) - np.outer(off, off))
    xx, yy, zz = np.diag(inertia).tolist()
    x, y, z = com.tolist()
    products = (float(inertia[0, 1]), float(inertia[0, 2]), float(inertia[1, 2]))
    return LinkInertia(ARM_MASS_KG, (x, y, z), (xx, yy, zz, *products))
