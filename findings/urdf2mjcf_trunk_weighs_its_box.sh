#!/usr/bin/env bash
# urdf2mjcf 0.2.39 beside mujoco 4.0.0: the trunk's mass, friction, effort limits and mimics of a URDF are lost.
#
# The first link's inertia is left out, so that MuJoCo takes it from its collision shapes at the density of water: a
# trunk of 5 kg weighs 8. Damping, friction, effort limits and mimic joints of the URDF are not in the MJCF; the motors
# have no limit. Of an inertia only the diagonal is written, which a warning says. MuJoCo's own reader of the same URDF
# keeps all of these, if it is told to keep the trunk (fusestatic="false"). Whoever converts: compare body_mass,
# dof_damping, dof_frictionloss, jnt_actfrcrange and neq of both.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "urdf2mjcf==0.2.39" "mujoco==4.0.0" "numpy==2.4.6"
"$folder/venv/bin/python" - "$folder" <<'PY'
import sys
from importlib.metadata import version
from pathlib import Path

import mujoco
import numpy as np
from urdf2mjcf.convert import convert_urdf_to_mjcf

assert version("urdf2mjcf") == "0.2.39" and mujoco.__version__ == "4.0.0"


def link(name, mass_kg, shape=""):
    """A link whose mass lies at its origin."""
    inertia = 'ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.04"'
    inertial = f'<inertial><origin xyz="0 0 0"/><mass value="{mass_kg}"/><inertia {inertia}/></inertial>'
    return f'<link name="{name}">{inertial}{shape}</link>'


def joint(name, parent, child, more):
    """A hinge about y."""
    limit = '<limit lower="-1" upper="1.5" effort="5" velocity="2"/>'
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="revolute">{ends}<axis xyz="0 1 0"/>{limit}{more}</joint>'


box = '<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision>'
robot = f"""<robot name="leg"><mujoco><compiler fusestatic="false"/></mujoco>
  {link("trunk", 5, box)}{link("upper", 2)}{link("lower", 1)}
  {joint("hip", "trunk", "upper", '<dynamics damping="0.5" friction="0.3"/>')}
  {joint("knee", "upper", "lower", '<mimic joint="hip" multiplier="-2"/>')}</robot>"""
urdf, mjcf = Path(sys.argv[1]) / "leg.urdf", Path(sys.argv[1]) / "leg.xml"
urdf.write_text(robot)
convert_urdf_to_mjcf(urdf, mjcf)
direct, converted = mujoco.MjModel.from_xml_path(str(urdf)), mujoco.MjModel.from_xml_path(str(mjcf))

for name, model in (("MuJoCo reads", direct), ("converted", converted)):
    hip = model.joint("hip")
    limits = model.jnt_actfrcrange[hip.id]
    print(
        f"{name}: trunk {model.body('trunk').mass[0]:g} kg, hip damping {hip.damping.flat[0]:g}, "
        f"friction {hip.frictionloss.flat[0]:g}, torque limits {limits}, equalities {model.neq}"
    )
assert np.isclose(direct.body("trunk").mass[0], 5.0) and np.isclose(converted.body("trunk").mass[0], 8.0)
assert np.isclose(direct.joint("hip").damping.flat[0], 0.5) and converted.joint("hip").damping.flat[0] == 0.0
assert np.isclose(direct.joint("hip").frictionloss.flat[0], 0.3) and converted.joint("hip").frictionloss.flat[0] == 0.0
assert direct.jnt_actfrcrange[direct.joint("hip").id].tolist() == [-5.0, 5.0]
assert not converted.jnt_actfrclimited.any() and not converted.actuator_forcelimited.any()
assert (direct.neq, converted.neq) == (1, 0)
PY
