#!/usr/bin/env bash
# mujoco 4.0.0: a legged robot's URDF loads without its trunk, whose mass is gone.
#
# A URDF does not say whether its first link floats. MuJoCo melts it into the world, together with what is fixed to it
# (an IMU): there is no body of that name, and the total mass is that of the legs. fusestatic="false" does not free it:
# the trunk is a body again, but cannot move.
# Beside it: effort="0" is no limit at all.
# Whoever loads one: MjSpec.from_string, add_freejoint() to its first body, then compile.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "mujoco==4.0.0"
"$folder/venv/bin/python" - <<'PY'
import mujoco


def link(name, mass_kg):
    inertia = '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
    return f'<link name="{name}"><inertial><mass value="{mass_kg}"/>{inertia}</inertial></link>'


URDF = f"""
<robot name="biped">{link("trunk", 10)}{link("imu", 0.5)}{link("leg", 1)}
  <joint name="screwed" type="fixed"><parent link="trunk"/><child link="imu"/></joint>
  <joint name="hip" type="revolute"><parent link="trunk"/><child link="leg"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="7" velocity="3"/></joint>
</robot>"""
UNFUSED = URDF.replace("<link", '<mujoco><compiler fusestatic="false"/></mujoco><link', 1)


def told(model):
    """The bodies with their masses, and the number of degrees of freedom."""
    return {model.body(i).name: float(model.body_mass[i]) for i in range(1, model.nbody)}, model.nv


assert mujoco.__version__ == "4.0.0"
loaded, unfused = mujoco.MjModel.from_xml_string(URDF), mujoco.MjModel.from_xml_string(UNFUSED)
spec = mujoco.MjSpec.from_string(URDF)
spec.body("trunk").add_freejoint()
freed = spec.compile()
for name, model in (("loaded", loaded), ("fusestatic=false", unfused), ("add_freejoint", freed)):
    print(f"{name}: {told(model)}")
assert told(loaded) == ({"leg": 1.0}, 1)
assert told(unfused) == ({"trunk": 10.0, "imu": 0.5, "leg": 1.0}, 1)
assert told(freed) == ({"trunk": 10.5, "leg": 1.0}, 7)
unknown = mujoco.MjModel.from_xml_string(URDF.replace('effort="7"', 'effort="0"'))
for effort, model in ((7, loaded), (0, unknown)):
    print(f"with an effort of {effort} N m, the hip's torque is limited: {bool(model.jnt_actfrclimited[0])}")
assert loaded.jnt_actfrcrange[0].tolist() == [-7.0, 7.0] and not unknown.jnt_actfrclimited[0]
PY
