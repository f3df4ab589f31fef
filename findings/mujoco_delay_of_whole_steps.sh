#!/usr/bin/env bash
# mujoco 4.0.0: an actuator's delay of whole time steps is now and then one step longer.
#
# A motor has delay="0.01" at a time step of 0.005 s, or 0.01 at 0.0025 s. With the default interpolation, the force is
# that of two (four) steps ago in four steps of five, and that of three (five) steps ago in the fifth: the command's
# time and the time that is looked for differ in the last bit. With interp="linear" it is always two (four), and so it
# is with both at steps of 0.001, 0.002 and 0.003 s.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "mujoco==4.0.0" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
from collections import Counter

import mujoco
import numpy as np


def delays(step_s, steps, interp):
    """How often a force is the command of so many steps ago, over 4,000 steps of random commands."""
    xml = f"""
    <mujoco><option timestep="{step_s}"/>
      <worldbody><body><joint name="j" type="slide" axis="1 0 0" damping="100"/><geom size="0.1"/></body></worldbody>
      <actuator><motor joint="j" delay="{steps * step_s:.6f}" nsample="{steps + 2}" interp="{interp}"/></actuator>
    </mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    commands = np.random.default_rng(0).uniform(-1.0, 1.0, 4000)
    forces = []
    for command in commands:
        data.ctrl[0] = command
        mujoco.mj_step(model, data)
        forces.append(float(data.actuator_force[0]))
    found = Counter()
    for k in range(20, 4000):
        found[next(n for n in range(12) if abs(forces[k] - commands[k - n]) < 1e-9)] += 1
    return dict(found)


assert mujoco.__version__ == "4.0.0"
for step_s, steps in ((0.001, 5), (0.002, 2), (0.003, 3), (0.005, 2), (0.0025, 4)):
    for interp in ("zoh", "linear"):
        found = delays(step_s, steps, interp)
        print(f"step {step_s} s, delay of {steps} steps, {interp}: {found}")
        is_odd = interp == "zoh" and step_s in (0.005, 0.0025)
        assert set(found) == ({steps, steps + 1} if is_odd else {steps}), found
PY
