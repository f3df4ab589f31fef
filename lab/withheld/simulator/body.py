"""The compiled MuJoCo model of one robot: its body, feet and contacts, then its faults and ordinary errors.

The body has Spot's published kinematics with masses and inertias of its own. Total mass is 31.8 kg, between the
vendor's model without an arm (31.6 kg) and its data sheet (32.5 kg). Inertias lie within 6 % of the vendor's model and
have no products.
"""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from spot_model.robot import facts
from spot_model.robot.facts import FOOT_RADIUS_M, LEG_NAMES, N_JOINTS
from spot_model.robot.mjcf import default_height_m
from withheld.simulator.parameters import Settings
from withheld.simulator.robot import Robot

Vector = tuple[float, float, float]
Link = tuple[float, Vector, Vector]
"""Mass (kg), centre of mass (m) and principal inertia (kg·m²) of the front-left leg's link."""

BODY: Final[Link] = (16.95, (0.001, 0.0, -0.004), (0.0840, 0.5560, 0.5780))
LEG: Final[tuple[Link, Link, Link]] = (
    (1.150, (-0.0155, 0.0083, 0.0), (0.00126, 0.00160, 0.00170)),
    (2.220, (0.0020, -0.0108, -0.0795), (0.0266, 0.0252, 0.0033)),
    (0.342, (0.0055, 0.0, -0.1710), (0.0072, 0.0073, 0.00015)),
)
LINK_NAMES: Final = ("hip", "uleg", "lleg")
CONTACT: Final = 'conaffinity="1" condim="3" priority="1" friction="0.8 0.005 0.0001"'


def robot_mjcf(height_m: float) -> str:
    """A free base and twelve hinges without motors: torques are applied to the joints.

    Args:
        height_m: Of the body's origin at the start.
    """
    legs = "".join(_leg(leg) for leg in facts.LEG_NAMES)
    feet = "".join(
        f'<contact name="{leg}_foot" geom1="{leg}_foot" num="1" reduce="netforce" data="found force"/>'
        for leg in facts.LEG_NAMES
    )
    return f"""<mujoco model="judged">
  <compiler angle="radian" autolimits="true"/>
  <option><flag island="disable"/></option>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <geom name="ground" type="plane" size="0 0 1" contype="1"/>
    <body name="body" pos="0 0 {height_m}"><freejoint/>{_inertial(BODY)}
      <geom name="body" type="box" size="0.40 0.11 0.08" {CONTACT}/>{legs}
    </body>
  </worldbody>
  <sensor>{feet}</sensor>
</mujoco>"""


def _leg(leg: str) -> str:
    side, end = facts.side_sign(leg), facts.end_sign(leg)
    hip, thigh, shank = LEG
    (x, y, z), (_, out, _) = facts.HX_FROM_BODY_M, facts.HY_FROM_HX_M
    first = facts.JOINT_NAMES.index(f"{leg}_hx")
    joints = [_joint(first + k, axis) for k, axis in enumerate(("1 0 0", "0 1 0", "0 1 0"))]
    knee, foot = _numbers(facts.KN_FROM_HY_M), _numbers(facts.FOOT_FROM_KN_M)
    return f"""
      <body name="{leg}_hip" pos="{end * x} {side * y} {z}">{joints[0]}{_inertial(hip, side, end)}
        <body name="{leg}_uleg" pos="0 {side * out} 0">{joints[1]}{_inertial(thigh, side)}
          <geom type="capsule" size="0.04" fromto="0 0 0 {knee}" {CONTACT}/>
          <body name="{leg}_lleg" pos="{knee}">{joints[2]}{_inertial(shank, side)}
            <geom type="capsule" size="0.018" fromto="0 0 0 0 0 -0.25" {CONTACT}/>
            <geom name="{leg}_foot" type="ellipsoid" size="0.036 0.036 0.036" pos="{foot}" {CONTACT}/>
          </body>
        </body>
      </body>"""


def _joint(index: int, axis: str) -> str:
    low, high = facts.POSITION_LOW_RAD[index], facts.POSITION_HIGH_RAD[index]
    return f'<joint name="{facts.JOINT_NAMES[index]}" axis="{axis}" range="{low} {high}"/>'


def _inertial(link: Link, side: int = 1, end: int = 1) -> str:
    mass, (x, y, z), inertia = link
    return f'<inertial mass="{mass}" pos="{end * x} {side * y} {z}" diaginertia="{_numbers(inertia)}"/>'


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(repr(float(v)) for v in values)


FOOT_WIDTH = 1.12
"""Half of a foot's width over the nominal radius: a little wider than long, and wear takes none of it."""
_INTEGRATORS = {
    "implicit": mujoco.mjtIntegrator.mjINT_IMPLICIT,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
}


def build_model(robot: Robot, settings: Settings) -> mujoco.MjModel:
    """The compiled body. Its twelve joints follow the free joint, whatever a fault adds comes after them."""
    spec = mujoco.MjSpec.from_string(robot_mjcf(default_height_m()))
    spec.option.timestep = settings.step_s
    spec.option.integrator = _INTEGRATORS[settings.integrator]
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = settings.impratio
    for i, leg in enumerate(LEG_NAMES):
        foot = spec.geom(f"{leg}_foot")
        radius = robot.foot_radius_m[i]
        foot.size = [radius, FOOT_WIDTH * FOOT_RADIUS_M, radius]
        foot.friction[0] = robot.foot_friction[i]
        scale, damping = robot.foot_softness[i], robot.foot_damping[i]
        foot.solref = [
            -settings.contact_stiffness_per_s2 / scale**2,
            -settings.contact_damping_per_s * damping / scale,
        ]
    for edit_spec in robot.spec_edits:
        edit_spec(spec)
    model = spec.compile()
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    for edit_model in robot.model_edits:
        edit_model(model)
    # The rotor of a rigid gear is part of its joint; that of an elastic one is simulated by the drive.
    model.dof_armature[6 : 6 + N_JOINTS] = np.where(robot.drive.is_elastic, 0.0, robot.drive.rotor_inertia_kg_m2)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model
