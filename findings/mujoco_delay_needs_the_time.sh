#!/usr/bin/env bash
# mujoco 4.0.0: a state without its time, or a time set by hand, takes an actuator's delay away.
#
# mjSTATE_PHYSICS holds the commands that are on their way, each with the time at which it was given, but not data.time.
# Put into a fresh MjData, whose time is 0, the next command acts after one step where the delay is three. The same
# happens where a reset puts back positions and sets data.time to 0 by itself. mjSTATE_FULLPHYSICS, which has the time,
# and mj_resetData, which empties the history, keep the delay.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "mujoco==4.0.0" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
import mujoco
import numpy as np

XML = """
<mujoco><option timestep="0.002"/>
  <worldbody><body><joint name="j" type="slide" axis="1 0 0" damping="1"/><geom size="0.1"/></body></worldbody>
  <actuator><motor joint="j" delay="0.006" nsample="5"/></actuator>
</mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)


def walked():
    """Ten steps with the commands 0 to 9."""
    data = mujoco.MjData(model)
    for k in range(10):
        data.ctrl[0] = k
        mujoco.mj_step(model, data)
    return data


def next_forces(data):
    """The forces of six steps with the command 100."""
    forces = []
    for _ in range(6):
        data.ctrl[0] = 100.0
        mujoco.mj_step(model, data)
        forces.append(float(data.actuator_force[0]))
    return forces


def restored(kind):
    """A fresh MjData with such a state."""
    state = np.zeros(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, walked(), state, kind)
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, state, kind)
    return data


assert mujoco.__version__ == "4.0.0"
right = [7.0, 8.0, 9.0, 100.0, 100.0, 100.0]
by_hand, reset = walked(), walked()
by_hand.time = 0.0
mujoco.mj_resetData(model, reset)
seen = {
    "it goes on": next_forces(walked()),
    "mjSTATE_FULLPHYSICS": next_forces(restored(mujoco.mjtState.mjSTATE_FULLPHYSICS)),
    "mjSTATE_PHYSICS": next_forces(restored(mujoco.mjtState.mjSTATE_PHYSICS)),
    "time set to 0": next_forces(by_hand),
    "mj_resetData": next_forces(reset),
}
for name, forces in seen.items():
    print(f"{name}: {forces}")
assert seen["it goes on"] == seen["mjSTATE_FULLPHYSICS"] == right
assert seen["mj_resetData"] == [0.0, 0.0, 0.0, 100.0, 100.0, 100.0]
for name in ("mjSTATE_PHYSICS", "time set to 0"):
    assert seen[name][1:] == [100.0] * 5, name
PY
