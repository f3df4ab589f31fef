#!/usr/bin/env bash
# sapien 3.0.3: every joint of a URDF has friction 0.05, whatever it says; its limits of torque and speed are lost.
#
# The loader keeps a joint's damping and leaves the rest: friction="0" and friction="0.3" both load as 0.05, effort="5"
# as 3.4e38 N m, velocity="0.7" as 100 rad/s. The friction acts under load: an arm of 1 kg on an upright axis, without
# any friction in its file, stops from 1 rad/s within half a second under gravity, and turns on without. Every link is
# damped by 0.05 besides. Whoever loads a robot: set friction, force limit and link damping by hand.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "sapien==3.0.3" "numpy==2.4.6" "setuptools==80.9.0"
cd "$folder"
venv/bin/python - <<'PY'
import warnings
from importlib.metadata import version

warnings.simplefilter("ignore")
import numpy as np
import sapien

assert version("sapien") == "3.0.3"
INERTIAL = '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
ARM = """<robot name="arm"><link name="post">{inertial}</link><link name="arm">{inertial}</link>
<joint name="j" type="{kind}"><parent link="post"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="5" velocity="0.7"/>
<dynamics damping="{damping}" friction="{friction}"/></joint></robot>"""


def swing(*, damping=0.0, friction=0.0, gravity=0.0, own_friction=None, kind="continuous"):
    """The joint as loaded, and the speed of the arm half a second after 1 rad/s."""
    sapien.physx.set_scene_config(gravity=[0.0, 0.0, -gravity])
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    scene.set_timestep(0.001)
    loader = scene.create_urdf_loader()
    loader.fix_root_link = True
    with open("arm.urdf", "w") as file:
        file.write(ARM.format(kind=kind, inertial=INERTIAL, damping=damping, friction=friction))
    robot = loader.load("arm.urdf")
    joint = robot.get_active_joints()[0]
    loaded = joint.damping, joint.friction, joint.force_limit, joint.max_velocity, robot.links[1].angular_damping
    if own_friction is not None:
        joint.set_friction(own_friction)
    robot.set_qvel([1.0])
    for _ in range(500):
        scene.step()
    return np.array(loaded), float(robot.get_qvel()[0])


for kind in ("continuous", "revolute"):
    for told in (0.0, 0.3):
        loaded, _ = swing(friction=told, damping=0.1, kind=kind)
        print(f"{kind}, friction {told} in the file: damping, friction, force, speed, link damping", loaded)
        assert np.allclose(loaded[[0, 1, 3, 4]], [0.1, 0.05, 100.0, 0.05]) and loaded[2] > 1e38
(_, free), (_, carrying), (_, own) = swing(), swing(gravity=9.81), swing(gravity=9.81, own_friction=0.0)
print(f"half a second after 1 rad/s: {free:.3f}, under gravity {carrying:.3f}, with friction set to 0 {own:.3f}")
assert 0.97 < free < 0.98 and abs(carrying) < 0.01 and abs(own - free) < 1e-3
PY
