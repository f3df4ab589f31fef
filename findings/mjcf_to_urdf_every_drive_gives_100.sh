#!/usr/bin/env bash
# mjcf-urdf-simple-converter 0.7.3 beside mujoco 4.0.0: every joint of its URDF may give 100 N m, and the feet are gone.
#
# Whatever MJCF says of a joint, its URDF has effort="100" and velocity="100". Damping, friction and armature are lost.
# So is a foot that is a sphere: nothing of the URDF can touch the floor. A joint with ref="0.3" is 0.3 rad further at
# the same number. Masses and lengths are right, so pictures show little of it, and no line of output speaks of it.
# Whoever converts a robot: add limits, dynamics and feet by hand, and subtract ref from the angles.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "mjcf-urdf-simple-converter==0.7.3" "mujoco==4.0.0" "numpy==2.4.6"
cd "$folder"
cat >leg.xml <<'MJCF'
<mujoco model="leg"><compiler angle="radian"/><worldbody>
  <body name="thigh" pos="0.1 0 0.6">
    <joint name="hip" axis="0 1 0" range="-1 2" ref="0.3" damping="0.5" frictionloss="0.3" armature="0.02"/>
    <inertial mass="1.5" pos="0 0 -0.1" diaginertia="0.02 0.02 0.001"/>
    <body name="shin" pos="0 0 -0.3">
      <joint name="knee" axis="0 1 0" range="-2.7 -0.2" actuatorfrcrange="-45 45"/>
      <inertial mass="0.5" pos="0 0 -0.15" diaginertia="0.004 0.004 0.0002"/>
      <geom type="sphere" size="0.03" pos="0 0 -0.3" mass="0"/>
    </body>
  </body>
</worldbody><actuator><motor joint="hip" forcerange="-60 60"/><motor joint="knee"/></actuator></mujoco>
MJCF
venv/bin/python - <<'PY'
import contextlib
import io
import xml.etree.ElementTree as ET
from importlib.metadata import version

import mjcf_urdf_simple_converter
import mujoco
import numpy as np

assert version("mjcf-urdf-simple-converter") == "0.7.3" and mujoco.__version__ == "4.0.0"
said = io.StringIO()
with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
    mjcf_urdf_simple_converter.convert("leg.xml", "leg.urdf")
print("it prints:", repr(said.getvalue()))
assert said.getvalue().strip() == ""
robot = ET.parse("leg.urdf").getroot()
joints = [joint for joint in robot.iter("joint") if joint.get("type") != "fixed"]
limits = {joint.get("name"): joint.find("limit").attrib for joint in joints}
print(limits)
assert all(limits[name]["effort"] == limits[name]["velocity"] == "100" for name in ("hip", "knee"))
assert not [*robot.iter("dynamics")] and not [*robot.iter("collision")] and not [*robot.iter("visual")]

before, after = mujoco.MjModel.from_xml_path("leg.xml"), mujoco.MjModel.from_xml_path("leg.urdf")
assert before.ngeom == 1 and after.ngeom == 0
assert before.dof_damping.any() and before.dof_frictionloss.any() and before.dof_armature.any()
assert not after.dof_damping.any() and not after.dof_frictionloss.any() and not after.dof_armature.any()
print("mass", before.body_mass.sum(), after.body_mass.sum())
assert abs(before.body_mass.sum() - after.body_mass.sum()) < 0.01


def knee(model: mujoco.MjModel, hip_rad: float) -> np.ndarray:
    """Where the knee's axis passes."""
    data = mujoco.MjData(model)
    data.qpos[:] = hip_rad, -1.0
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return data.xanchor[1].copy()


print("the knee at hip 0.5:", knee(before, 0.5), knee(after, 0.5), "and at 0.2:", knee(after, 0.2))
assert np.linalg.norm(knee(before, 0.5) - knee(after, 0.5)) > 0.08
assert np.allclose(knee(before, 0.5), knee(after, 0.2))
PY
