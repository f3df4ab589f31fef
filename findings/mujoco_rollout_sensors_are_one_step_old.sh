#!/usr/bin/env bash
# mujoco 4.0.0: what mujoco.rollout returns as sensor data belongs to the state before the one that it returns.
#
# rollout gives states and sensor data as two arrays of the same length. states[k] is the state after step k;
# sensordata[k] is of the state before it, as mj_step leaves it. A joint's position sensor beside the joint's position
# is one time step late. A fit that compares both with a log is off by a step; mj_forward from each state, or
# shifting one of the arrays, mends it.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "mujoco==4.0.0" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
import mujoco
import numpy as np
from mujoco import rollout

XML = """
<mujoco><option timestep="0.003"/>
  <worldbody><body><joint name="j" axis="0 1 0"/><geom size="0.1" pos="0.3 0 0"/></body></worldbody>
  <actuator><position joint="j" kp="60"/></actuator>
  <sensor><jointpos joint="j"/></sensor>
</mujoco>"""
assert mujoco.__version__ == "4.0.0"
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
start = np.zeros(mujoco.mj_stateSize(model, kind))
mujoco.mj_getState(model, data, start, kind)
states, sensors = rollout.rollout(model, data, start[None], np.full((1, 50, 1), 0.3))
position, sensed = states[0, :, 1], sensors[0, :, 0]
print("positions", position[:4])
print("sensor   ", sensed[:4])
assert len(position) == len(sensed) == 50
assert np.array_equal(sensed[1:], position[:-1]) and sensed[0] == start[1]
assert not np.allclose(sensed, position)
PY
