#!/usr/bin/env bash
# mujoco 4.0.0 (mujoco.sysid): commands that a robot holds are replayed as ramps, and the numbers found make up for it.
#
# The residual of mujoco.sysid puts the control signal on the simulation's time steps by straight lines. A robot holds a
# set-point until the next one comes. So set-points at 50 Hz arrive 10 ms early on the average, and smoothed: of data
# without noise, made by the very model that is fitted, a damping of 0.30 is found as 0.44, and a delay of 9 ms where
# there is none. Whoever identifies a robot: give the control signal as control.resample(target_dt=timestep,
# method="zoh"); then 0.30 and 0.0 ms come out.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "mujoco[sysid]==4.0.0" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
import contextlib
import io

import mujoco
import numpy as np
from mujoco import sysid

assert mujoco.__version__ == "4.0.0"
DAMPING, PERIOD_S, STEP_S = 0.3, 0.02, 0.002
ARM = f"""<mujoco><option timestep="{STEP_S}" gravity="0 0 0" integrator="implicitfast"/><worldbody><body>
  <joint name="j" axis="0 0 1" damping="{DAMPING}" armature="0.02"/>
  <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass="1" contype="0" conaffinity="0"/>
</body></worldbody><actuator><position name="a" joint="j" kp="60" kv="1.5"/></actuator>
<sensor><jointpos name="angle" joint="j"/></sensor></mujoco>"""
model = mujoco.MjModel.from_xml_string(ARM)
set_points = 0.3 * np.random.default_rng(0).normal(size=200)

data = mujoco.MjData(model)
times, angles = [], []
for step in range(1950):
    data.ctrl[0] = set_points[int(step * STEP_S / PERIOD_S + 1e-9)]
    mujoco.mj_step(model, data)
    times.append(data.time)
    angles.append(data.sensordata.copy())  # of the state before the step, as in the residual
measured = sysid.TimeSeries.from_names(np.array(times), np.array(angles), model)
logged = sysid.TimeSeries.from_control_names(np.arange(200) * PERIOD_S, set_points[:, None], model, ["a"])


def set_damping(spec: mujoco.MjSpec, parameter: sysid.Parameter) -> None:
    spec.joint("j").damping[0] = float(parameter.value[0])


def found(control: sysid.TimeSeries, parameter: sysid.Parameter) -> float:
    parameters = sysid.ParameterDict()
    parameters.add(parameter)
    at_rest = sysid.create_initial_state(model, np.zeros(1))
    spec = mujoco.MjSpec.from_string(ARM)
    sequences = [sysid.ModelSequences("arm", spec, "run", at_rest, control, measured)]
    options = {}
    if parameter.name == "delay":
        transform = sysid.SignalTransform()
        transform.delay("*", parameters["delay"])
        options["modify_residual"] = transform.apply
    residual = sysid.build_residual_fn(models_sequences=sequences, **options)
    with contextlib.redirect_stdout(io.StringIO()):
        _, result = sysid.optimize(parameters, residual, verbose=False)
    return float(result.x[0])


for name, control in (("as logged", logged), ("held", logged.resample(target_dt=STEP_S, method="zoh"))):
    damping = found(control, sysid.Parameter("damping", 0.5, 0.0, 3.0, modifier=set_damping))
    delay_s = found(control, sysid.Parameter("delay", 0.001, -0.03, 0.03))
    print(f"set-points {name}: damping {damping:.2f} (truly {DAMPING}), delay {delay_s * 1e3:.1f} ms (truly 0)")
    if name == "held":
        assert abs(damping - DAMPING) < 0.01 and abs(delay_s) < 2e-4
    else:
        assert 0.42 < damping < 0.46 and 0.0085 < delay_s < 0.0095
PY
