#!/usr/bin/env bash
# mujoco 4.0.0 (mujoco.sysid): a gain is never found by default, a bias runs to its bound, and delays add up.
#
# SignalTransform.gain() and bias() act on the measured and the predicted signal alike unless told otherwise. Then a
# gain cancels, since residuals are divided by the measured signal's size: the gradient is zero, and the start comes
# back as the result ("exact minimum found?"). A bias makes that size grow, so the fit takes the largest one allowed.
# With target="predicted" both are found. apply_delay() shifts the series that it is given, in place (apply_gain and
# apply_bias copy): called again in a residual, 10 ms become 20. Whoever fits a sensor: name the target, and copy first.
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
STEP_S = 0.002
ARM = f"""<mujoco><option timestep="{STEP_S}" gravity="0 0 0"/><worldbody><body>
  <joint name="j" axis="0 0 1" damping="0.3"/>
  <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass="1" contype="0" conaffinity="0"/>
</body></worldbody><actuator><position name="a" joint="j" kp="60" kv="1.5"/></actuator>
<sensor><jointpos name="angle" joint="j"/></sensor></mujoco>"""
model = mujoco.MjModel.from_xml_string(ARM)
times = np.arange(1000) * STEP_S
set_points = 0.3 + 0.3 * np.sin(9.0 * times)
data = mujoco.MjData(model)
angles = []
for set_point in set_points:
    data.ctrl[0] = set_point
    mujoco.mj_step(model, data)
    angles.append(data.qpos.copy())
angles = np.array(angles)
control = sysid.TimeSeries.from_control_names(times, set_points[:, None], model, ["a"])
at_rest = sysid.create_initial_state(model, np.zeros(1))


def found(kind: str, sensor: np.ndarray, start: float, bounds: tuple[float, float], **options: str) -> float:
    """The gain or bias of a sensor that reads so."""
    parameters = sysid.ParameterDict()
    parameters.add(sysid.Parameter(kind, start, *bounds))
    transform = sysid.SignalTransform()
    getattr(transform, kind)("angle", parameters[kind], **options)
    measured = sysid.TimeSeries.from_names(times + STEP_S, sensor, model)
    spec = mujoco.MjSpec.from_string(ARM)
    sequences = [sysid.ModelSequences("arm", spec, "run", at_rest, control, measured)]
    residual = sysid.build_residual_fn(models_sequences=sequences, modify_residual=transform.apply)
    with contextlib.redirect_stdout(io.StringIO()):
        _, result = sysid.optimize(parameters, residual, verbose=False)
    return float(result.x[0])


for options in ({}, {"target": "predicted"}):
    gain = found("gain", 1.5 * angles, 1.0, (0.2, 3.0), **options)
    bias = found("bias", angles + 0.1, 0.01, (-5.0, 5.0), **options)
    print(f"{options}: gain {gain:.2f} (truly 1.50), bias {bias:.2f} (truly 0.10)")
    if options:
        assert abs(gain - 1.5) < 0.02 and abs(bias - 0.1) < 0.01
    else:
        assert gain == 1.0 and abs(bias) > 4.99

ramp = sysid.TimeSeries.from_names(times, times[:, None].copy(), model)
delay = sysid.Parameter("delay", 0.01, 0.0, 0.1)
lags_ms = [1e3 * float(times[500] - sysid.apply_delay(ramp, "angle", delay).data[500, 0]) for _ in range(3)]
print("apply_delay of 10 ms, called three times:", [round(lag, 1) for lag in lags_ms])
assert np.allclose(lags_ms, [10.0, 20.0, 30.0])
for apply in (sysid.apply_gain, sysid.apply_bias):
    before = ramp.data.copy()
    apply(ramp, "angle", sysid.Parameter("number", 2.0, 0.0, 3.0))
    assert np.array_equal(ramp.data, before)
PY
