#!/usr/bin/env bash
# mujoco-mjx 3.17.0 beside mujoco 3.17.0: delays, quadratic damping and stiffness and more are left out without a word.
#
# mjx.put_model refuses what it does not know, such as a DC motor or the implicit integrator. Newer features it takes
# and ignores: the delay of an actuator or of a sensor, and the parts of damping and stiffness that grow with speed and
# deflection. The same model walks differently there, as if the robot had none of them. In a model that can have no
# constraint (no contact, limit or friction), accelerometer, force and torque sensors stay zero, since the step returns
# before it computes them. Whoever trains in MJX: compare some steps with MuJoCo's, with each feature that the model
# has.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pins=("mujoco-mjx==3.17.0" "mujoco==3.17.0" "jax==0.10.2" "jaxlib==0.10.2" "numpy==2.4.6")
"$folder/venv/bin/pip" install --quiet "${pins[@]}"
"$folder/venv/bin/python" - <<'PY'
import jax
import mujoco
import numpy as np
from mujoco import mjx

assert mujoco.__version__ == "3.17.0"
jax.config.update("jax_platforms", "cpu")
jax.config.update("jax_enable_x64", True)
STEPS = 20


def both(knee="", drive="", more=""):
    """A leg without contacts after 20 steps of 2 ms, in MuJoCo and in MJX: its angles and what its sensors say."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><compiler angle="radian"/><worldbody>
      <body><joint name="hip" axis="1 0 0"/><geom size="0.1" mass="1" contype="0" conaffinity="0"/>
        <body pos="0 0 -0.3"><joint name="knee" axis="0 1 0" {knee}/><site name="shank"/>
          <geom size="0.05" pos="0.1 0 -0.2" mass="1" contype="0" conaffinity="0"/></body></body></worldbody>
      <actuator><position joint="knee" kp="60" kv="1.5" {drive}/></actuator>{more}</mujoco>""")
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = [0.3, 0.15], [2.0, 3.0], 0.7
    model_x, data_x = mjx.put_model(model), mjx.put_data(model, data)
    step = jax.jit(mjx.step)
    for _ in range(STEPS):
        mujoco.mj_step(model, data)
        data_x = step(model_x, data_x)
    return (data.qpos, np.array(data_x.qpos)), (data.sensordata, np.array(data_x.sensordata))


angles, _ = both()
print("plain: knee at", angles[0][1], "and", angles[1][1])
assert np.allclose(*angles, atol=1e-9)
for what, options in {
    "an actuator's delay of 10 ms": {"drive": 'delay="0.01" nsample="8"'},
    "damping with a quadratic part": {"knee": 'damping="0.5 0.2"'},
    "stiffness with a quadratic part": {"knee": 'stiffness="3 20"'},
}.items():
    angles, _ = both(**options)
    print(f"{what}: knee at {angles[0][1]:.4f} rad in MuJoCo, {angles[1][1]:.4f} in MJX")
    assert abs(angles[0][1] - angles[1][1]) > 1e-3

_, sensors = both(more='<sensor><jointpos joint="knee" delay="0.01" nsample="8"/></sensor>')
print("a sensor's delay of 10 ms:", *sensors)
assert abs(sensors[0][0] - sensors[1][0]) > 0.01
accelerometer = '<sensor><accelerometer site="shank"/></sensor>'
for knee, zero in (("", True), ('range="-3 3"', False)):
    _, sensors = both(knee=knee, more=accelerometer)
    print("accelerometer", "without any constraint:" if zero else "with a limit at the knee:", *sensors)
    assert not np.allclose(sensors[0], 0.0) and np.allclose(sensors[1], 0.0) == zero
PY
