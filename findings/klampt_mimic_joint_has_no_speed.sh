#!/usr/bin/env bash
# klampt 0.10.1.post1: a driver that moves a mimic joint too has an empty range of speeds, from +12 to +10 rad/s.
#
# A URDF joint of 12 rad/s with a mimic joint of 20 rad/s and multiplier 2 becomes one driver. It may turn at -10 to 10
# rad/s; getVelocityLimits() says 12 to 10: both ends are positive, the larger one first, so that standing still lies
# outside as well. With multiplier 1 it is 20 to 12, instead of -12 to 12. Limits of angle and torque are right. Every
# joint also has a limit of 10 rad/s2 that no URDF states. Whoever plans with drivers: take the limits of the links.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "klampt==0.10.1.post1" "numpy==2.4.6"
cd "$folder"
venv/bin/python - <<'PY'
from importlib.metadata import version

import klampt

assert version("klampt") == "0.10.1.post1"
LINK = """<link name="{}"><inertial><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
LEG = f"""<robot name="leg">{LINK.format("trunk")}{LINK.format("hip")}{LINK.format("shin")}
<joint name="hx" type="revolute"><parent link="trunk"/><child link="hip"/><origin xyz="0 0 0"/><axis xyz="1 0 0"/>
<limit lower="-0.8" upper="0.8" effort="45" velocity="12"/></joint>
<joint name="kn" type="revolute"><parent link="hip"/><child link="shin"/><origin xyz="0 0 0"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="110" velocity="20"/><mimic joint="hx" multiplier="{{multiplier}}"/></joint>
</robot>"""

CASES = (2, 10.0, [12.0, 10.0]), (-2, 10.0, [12.0, 10.0]), (1, 12.0, [20.0, 12.0])
for multiplier, right, seen in CASES:
    with open("leg.urdf", "w") as file:
        file.write(LEG.format(multiplier=multiplier))
    world = klampt.WorldModel()
    robot = world.loadRobot("leg.urdf")
    driver = robot.driver(0)
    speeds = [*driver.getVelocityLimits()]
    print(f"multiplier {multiplier}: speeds {speeds}, truly {[-right, right]};", end=" ")
    print("angles", driver.getLimits(), "torques", driver.getTorqueLimits())
    assert robot.numDrivers() == 1 and driver.getType() == "affine" and speeds == seen
    assert [*driver.getLimits()] == [-0.8, 0.8] and [*driver.getTorqueLimits()] == [-45.0, 45.0]
    assert [*robot.getAccelerationLimits()][-2:] == [10.0, 10.0]
PY
