#!/usr/bin/env bash
# mujoco-warp 4.0.0: the time of a simulation is in single precision; after minutes its clock goes wrong, and delays.
#
# data.time grows by a time step in each step, rounded to what a float32 holds there. At steps of 2 ms the clock is
# 0.7 % fast from 256 s on, 2.3 % slow from 1,024 s on, twice as fast from 32,768 s on, and stands still from 65,536 s
# on. An actuator's delay compares such times: one of three steps takes four from 1,024 s on, and two where the clock is
# twice as fast. MuJoCo's own clock, in double precision, is right in all of these.
# Whoever simulates long: count steps instead of reading the time, and reset the time (and the history) now and then.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "mujoco-warp==4.0.0" "mujoco==4.0.0" "warp-lang==1.19.0" "numpy==2.4.6"
WARP_CACHE_PATH="$folder/kernels" "$folder/venv/bin/python" - <<'PY'
from importlib.metadata import version

import mujoco
import numpy as np
import warp

warp.config.log_level = warp.LOG_ERROR
import mujoco_warp

assert version("mujoco-warp") == "4.0.0"
STEP_S, N = 0.002, 40
XML = f"""
<mujoco><option timestep="{STEP_S}" gravity="0 0 0"><flag contact="disable"/></option>
  <worldbody><body><joint name="j" type="slide" axis="1 0 0" damping="100"/><geom size="0.1"/></body></worldbody>
  <actuator><motor joint="j" delay="0.006" nsample="6"/></actuator>
</mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)


def walk(start_s):
    """How fast both clocks go at this time, and the delay in steps, of one command after N steps, with Warp."""
    data = mujoco.MjData(model)
    data.time = start_s
    on_warp = mujoco_warp.put_data(model, data)
    for k in range(N):
        data.ctrl[0] = k
        mujoco.mj_step(model, data)
        on_warp.ctrl.assign(np.array([[k]], np.float32))
        mujoco_warp.step(warp_model, on_warp)
    passed_s = float(on_warp.time.numpy()[0]) - float(np.float32(start_s))
    delay = N - 1 - float(on_warp.actuator_force.numpy()[0, 0])
    return passed_s / (N * STEP_S), (data.time - start_s) / (N * STEP_S), delay


with warp.ScopedDevice("cpu"):
    warp_model = mujoco_warp.put_model(model)
    seen = {start_s: walk(start_s) for start_s in (0.0, 260.0, 600.0, 1500.0, 40_000.0, 70_000.0)}
for start_s, (rate, rate_of_mujoco, delay) in seen.items():
    print(f"at {start_s} s: clock {rate:.4f} (MuJoCo's {rate_of_mujoco:.4f}), delay of 3 steps takes {delay:.0f}")
    assert abs(rate_of_mujoco - 1.0) < 1e-6
assert abs(seen[0.0][0] - 1.0) < 1e-4 and seen[0.0][2] == 3
assert 1.006 < seen[260.0][0] < 1.008 and 1.006 < seen[600.0][0] < 1.008
assert 0.976 < seen[1500.0][0] < 0.978 and seen[1500.0][2] == 4
assert 1.95 < seen[40_000.0][0] < 1.96 and seen[40_000.0][2] == 2
assert seen[70_000.0][0] == 0.0
PY
