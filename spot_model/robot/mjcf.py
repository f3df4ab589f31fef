"""The MuJoCo model of Spot, as MJCF text built from ``facts``: primitives only, no meshes, no mujoco import.

Names: bodies ``body`` and ``{leg}_hip``, ``{leg}_uleg``, ``{leg}_lleg``; joints, motors and torque sites by joint
name; geoms ``body``, ``{leg}_uleg``, ``{leg}_lleg``, ``{leg}_foot``; sites ``{leg}_foot`` and ``imu``; keyframe
``default``.
"""

from __future__ import annotations

import math

from spot_model.robot import facts
from spot_model.robot.mjcf_options import MjcfOptions
from spot_model.robot.terrain import terrain_asset, terrain_geom

__all__ = ["MjcfOptions", "default_height_m", "spot_mjcf"]

BODY_HALF_SIZE_M = (0.42, 0.12, 0.085)
UPPER_LEG_RADIUS_M = 0.045
LOWER_LEG_RADIUS_M = 0.02
"""Rough outlines for contact in a fall; they carry no mass."""

SHIN_SHARE = 0.75
"""How far down the lower leg it can touch the ground: a foot that lands hard sinks in by more than the difference of
the radii, and that is not a fall."""

IMU_FROM_BODY_M = (0.0, 0.0, 0.0)
"""The IMU site sits at the body's origin; a robot reports its own mounting point."""


def default_height_m() -> float:
    """Height of the body's origin at which the lowest foot just touches z = 0 in the default pose, m."""
    return max(_foot_depth_m(3 * i) for i in range(facts.N_LEGS)) + facts.FOOT_RADIUS_M


def spot_mjcf(options: MjcfOptions = MjcfOptions()) -> str:  # noqa: B008
    """Build the model: a free base and twelve torque motors in canonical order (ctrl = joint torque, N·m).

    Limits of torque and speed, friction and delays are effects, so the motors have no bound here.

    Returns:
        MJCF text for ``mujoco.MjModel.from_xml_string``.
    """
    legs = "".join(_leg(i, options) for i in range(facts.N_LEGS))
    motors = "".join(f'<motor name="{name}" joint="{name}" gear="1"/>' for name in facts.JOINT_NAMES)
    pose = [0.0, 0.0, default_height_m(), 1.0, 0.0, 0.0, 0.0, *facts.DEFAULT_POSITION_RAD.tolist()]
    half = _numbers(BODY_HALF_SIZE_M)
    return f"""<mujoco model="spot">
  <compiler angle="radian" autolimits="true" balanceinertia="false"
            discardvisual="{str(not options.visuals).lower()}"/>
  <option timestep="{options.timestep_s!r}" integrator="{options.integrator}" cone="{options.cone}"
          iterations="{options.solver_iterations}">
    <flag island="disable"/>
  </option>
  <visual><global offwidth="1280" offheight="720"/><headlight ambient="0.4 0.4 0.4"/></visual>
  <default>
    <geom group="2" contype="0" conaffinity="0"/>
    <joint type="hinge" damping="0" frictionloss="0"/>
    <default class="contact">
      <geom conaffinity="1" condim="3" priority="1" friction="{options.foot_friction!r} 0.005 0.0001"
            solref="{_numbers(options.contact_solref)}" solimp="{_numbers(options.contact_solimp)}"/>
    </default>
  </default>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="0.9 0.94 1" rgb2="0.5 0.6 0.75"
             width="64" height="384"/>
    <texture name="grid" type="2d" builtin="checker" rgb1="0.55 0.57 0.6" rgb2="0.48 0.5 0.53"
             width="256" height="256"/>
    <material name="ground" texture="grid" texrepeat="1 1" texuniform="true"/>
    <material name="yellow" rgba="0.98 0.78 0.1 1"/>
    <material name="black" rgba="0.1 0.1 0.11 1"/>
    <material name="grey" rgba="0.3 0.3 0.32 1"/>
    {terrain_asset(options.terrain)}
  </asset>
  <worldbody>
    <light pos="0 0 4" dir="0 0 -1" directional="true"/>
    {terrain_geom(options.terrain)}
    <body name="body" pos="0 0 {default_height_m()!r}">
      <freejoint name="base"/>
      {_inertial(facts.BODY)}
      <geom name="body" type="box" size="{half}" material="yellow"{_contact(options)}/>
      <geom type="box" size="0.02 0.1 0.06" pos="0.43 0 0" material="black"/>
      <geom type="box" size="0.02 0.1 0.06" pos="-0.43 0 0" material="black"/>
      <geom type="box" size="0.2 0.122 0.012" pos="0 0 0.078" material="black"/>
      <site name="imu" pos="{_numbers(IMU_FROM_BODY_M)}" size="0.01"/>
      {legs}
    </body>
  </worldbody>
  <actuator>{motors}</actuator>
  <sensor>{_sensors(options)}</sensor>
  <keyframe><key name="default" qpos="{_numbers(pose)}"/></keyframe>
</mujoco>
"""


def _leg(index: int, options: MjcfOptions) -> str:
    """One leg's bodies: hip, upper leg, lower leg with its foot."""
    leg = facts.LEG_NAMES[index]
    right, hind = facts.side_sign(leg) < 0, facts.end_sign(leg) < 0
    side, end = facts.side_sign(leg), facts.end_sign(leg)
    # The upper and lower legs point the same way at both ends; only the hip's motor housing turns round.
    hip = facts.HIP_FL.mirrored(left_right=right, front_hind=hind)
    upper = facts.UPPER_LEG_FL.mirrored(left_right=right)
    lower = facts.LOWER_LEG_FL.mirrored(left_right=right)
    hx_pos = (end * facts.HX_FROM_BODY_M[0], side * facts.HX_FROM_BODY_M[1], facts.HX_FROM_BODY_M[2])
    hy_pos = (facts.HY_FROM_HX_M[0], side * facts.HY_FROM_HX_M[1], facts.HY_FROM_HX_M[2])
    joints = [_joint(3 * index + k, "1 0 0" if k == 0 else "0 1 0", options) for k in range(3)]
    foot = _numbers(facts.FOOT_FROM_KN_M)
    shin_end = _numbers(SHIN_SHARE * x for x in facts.FOOT_FROM_KN_M)
    return f"""
      <body name="{leg}_hip" pos="{_numbers(hx_pos)}">
        {joints[0]}{_inertial(hip)}
        <geom type="capsule" fromto="{-0.06 * end} 0 0 {0.06 * end} 0 0" size="0.05" material="black"/>
        <body name="{leg}_uleg" pos="{_numbers(hy_pos)}">
          {joints[1]}{_inertial(upper)}
          <geom name="{leg}_uleg" type="capsule" fromto="0 0 0 {_numbers(facts.KN_FROM_HY_M)}"
                size="{UPPER_LEG_RADIUS_M}" material="yellow"{_contact(options)}/>
          <geom type="cylinder" fromto="0 {-0.03 * side} 0 0 {0.045 * side} 0" size="0.055" material="black"/>
          <body name="{leg}_lleg" pos="{_numbers(facts.KN_FROM_HY_M)}">
            {joints[2]}{_inertial(lower)}
            <geom type="capsule" fromto="0 0 0 {foot}" size="{LOWER_LEG_RADIUS_M}" material="grey"/>
            <geom name="{leg}_lleg" type="capsule" fromto="0 0 0 {shin_end}" size="{LOWER_LEG_RADIUS_M}"
                  material="grey"{_contact(options)}/>
            <geom name="{leg}_foot" class="contact" type="sphere" pos="{foot}" size="{facts.FOOT_RADIUS_M}"
                  material="black"/>
            <site name="{leg}_foot" pos="{foot}" size="0.01"/>
          </body>
        </body>
      </body>"""


def _joint(index: int, axis: str, options: MjcfOptions) -> str:
    name = facts.JOINT_NAMES[index]
    limits = _numbers((facts.POSITION_LOW_RAD[index], facts.POSITION_HIGH_RAD[index]))
    armature = options.armature_by_joint[index]
    return (
        f'<joint name="{name}" axis="{axis}" range="{limits}" armature="{armature!r}"/>'
        f'<site name="{name}" size="0.01"/>'
    )


def _inertial(link: facts.LinkInertia) -> str:
    diagonal, off_diagonal = link.inertia_kg_m2[:3], link.inertia_kg_m2[3:]
    # MuJoCo turns a full matrix into principal axes in its own order; a diagonal one keeps the link's axes.
    inertia = (
        f'fullinertia="{_numbers(link.inertia_kg_m2)}"' if any(off_diagonal) else f'diaginertia="{_numbers(diagonal)}"'
    )
    return f'<inertial mass="{link.mass_kg!r}" pos="{_numbers(link.com_m)}" {inertia}/>'


def _contact(options: MjcfOptions) -> str:
    """Let a geom touch the ground where the options say so."""
    return ' class="contact"' if options.collision == "all" else ""


def _sensors(options: MjcfOptions) -> str:
    """Net force of each foot on the ground (with the number of contacts), then link-side torques if asked."""
    feet = "".join(
        f'<contact name="{leg}_foot" geom1="{leg}_foot" num="1" reduce="netforce" data="found force"/>'
        for leg in facts.LEG_NAMES
    )
    torques = "".join(f'<torque name="{name}_link_torque" site="{name}"/>' for name in facts.JOINT_NAMES)
    return feet + (torques if options.link_torque_sensors else "")


def _foot_depth_m(first_joint: int) -> float:
    """How far one foot's centre is below the body's origin in the default pose, m."""
    hx, hy, kn = (float(v) for v in facts.DEFAULT_POSITION_RAD[first_joint : first_joint + 3])
    side = 1.0 if hx >= 0.0 else -1.0
    (ux, _, uz), (_, _, lz) = facts.KN_FROM_HY_M, facts.FOOT_FROM_KN_M
    down = -ux * math.sin(hy) + uz * math.cos(hy) + lz * math.cos(hy + kn)
    out = side * facts.HY_FROM_HX_M[1]
    return -(out * math.sin(hx) + down * math.cos(hx))


def _numbers(values: object) -> str:
    """Space-separated numbers at full precision."""
    return " ".join(repr(float(v)) for v in values)  # type: ignore[attr-defined]
