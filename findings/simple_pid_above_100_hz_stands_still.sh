#!/usr/bin/env bash
# simple-pid 2.0.1: a controller that is told its time steps, of less than 10 ms, gives its first output for ever.
#
# The documentation has dt for simulations, "when simulation time is different from real time". But sample_time, 0.01 s
# by default, holds for dt, too: a call with a smaller one returns the last output, and its time is forgotten instead of
# added up. So a joint controller at 333 Hz, the rate of Spot's states, pushes with what it computed in the first call
# while the joint passes its set-point, and one at 101 Hz as well; at 100 Hz it works. Without dt, by the clock, the
# output changes at most every 10 ms. Whoever gives dt: give sample_time=None.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "simple-pid==2.0.1"
"$folder/venv/bin/python" - <<'PY'
from importlib.metadata import version

from simple_pid import PID

assert version("simple-pid") == "2.0.1"


def swing(rate_hz, **options):
    """A joint of 10 kg m2 under a PD controller for 1.2 s: outputs in N m, and where it ends; it shall go to 1 rad."""
    controller = PID(60.0, 0.0, 15.0, setpoint=1.0, **options)
    angle_rad = speed_rad_s = 0.0
    outputs = []
    for _ in range(round(1.2 * rate_hz)):
        outputs.append(controller(angle_rad, dt=1.0 / rate_hz))
        speed_rad_s += outputs[-1] / 10.0 / rate_hz
        angle_rad += speed_rad_s / rate_hz
    return outputs, angle_rad


for rate_hz in (333, 101, 100):
    outputs, angle_rad = swing(rate_hz)
    print(f"{rate_hz} Hz: {len(set(outputs))} different outputs of {len(outputs)}, ends at {angle_rad:.2f} rad")
    stands_still = len(set(outputs)) == 1 and angle_rad > 4.0
    assert stands_still == (rate_hz > 100)
outputs, angle_rad = swing(333, sample_time=None)
print(f"333 Hz with sample_time=None: {len(set(outputs))} different outputs, ends at {angle_rad:.2f} rad")
assert len(set(outputs)) > 300 and angle_rad < 2.0
PY
