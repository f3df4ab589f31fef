#!/usr/bin/env bash
# mink 1.3.0: a joint a hundredth of a radian outside its limit is thrown back in one step, or nothing is found at all.
#
# ConfigurationLimit bounds the next displacement, not a speed: of what a joint is outside, 95 % have to go within one
# step. A knee that a measurement puts 0.01 rad past its stop gets -4.75 rad/s with steps of 2 ms, and twice that with 1
# ms, with no other task than to stay where it is. With a VelocityLimit of 1 rad/s beside it the two contradict each
# other, and solve_ik raises NoSolutionFound, for all joints, as long as the joint is out: the robot gets no command.
# Whoever feeds measured joints: clip them to the limits before Configuration.update.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "mink==1.3.0" "mujoco==4.0.0" "daqp==0.11.0" "qpsolvers==4.13.0" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
from importlib.metadata import version

import mink
import mujoco
import numpy as np

assert version("mink") == "1.3.0"
model = mujoco.MjModel.from_xml_string("""<mujoco><compiler angle="radian"/><worldbody>
  <body><joint name="hip" axis="0 1 0" range="-1 1"/><geom size="0.05" pos="0 0 -0.2" mass="1"/>
    <body pos="0 0 -0.3"><joint name="knee" axis="0 1 0" range="-2 -0.2"/>
      <geom size="0.05" pos="0 0 -0.2" mass="1"/></body></body></worldbody></mujoco>""")
configuration = mink.Configuration(model)
stay = mink.PostureTask(model, cost=1.0)
inside = mink.ConfigurationLimit(model)


def speeds(knee_rad, step_s, limits):
    """What both joints are told, for a robot that shall stay where it is."""
    configuration.update(np.array([0.3, knee_rad]))
    stay.set_target_from_configuration(configuration)
    return mink.solve_ik(configuration, [stay], step_s, "daqp", limits=limits)


print("within:", speeds(-0.21, 0.002, [inside]), "rad/s")
assert np.allclose(speeds(-0.21, 0.002, [inside]), 0.0, atol=1e-6)
for step_s, expected in ((0.002, -4.75), (0.001, -9.5)):
    told = speeds(-0.19, step_s, [inside])
    print(f"0.01 rad outside, steps of {1000 * step_s:.0f} ms:", told, "rad/s")
    assert np.allclose(told, [0.0, expected], atol=1e-3)
slow = mink.VelocityLimit(model, {"hip": 1.0, "knee": 1.0})
assert np.allclose(speeds(-0.21, 0.002, [inside, slow]), 0.0, atol=1e-6)
try:
    speeds(-0.19, 0.002, [inside, slow])
except mink.NoSolutionFound as error:
    print("with a limit of 1 rad/s:", error)
else:
    raise AssertionError("a solution is found now")
PY
