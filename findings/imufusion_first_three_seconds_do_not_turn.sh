#!/usr/bin/env bash
# imufusion 1.3.3: turning in the first three seconds does not count, and settings given late bring back 100 Hz.
#
# While Ahrs starts up, for three seconds, the heading stays at zero, whatever the gyroscope says: a robot that turns at
# 90 degrees per second from the first sample is some 270 degrees off from then on, with no flag left that says so. Roll
# follows. skip_startup() counts from the first sample, but then begins level. set_settings() also sets the rate, 100 Hz
# unless told otherwise: called after set_sample_period(0.02) it makes every turn half as large; called before, it does
# not. Whoever replays a log: give sample_rate in the settings, and begin where the robot stands still.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "imufusion==1.3.3" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
from importlib.metadata import version

import imufusion
import numpy as np

assert version("imufusion") == "1.3.3"
PERIOD_S, RATE_DEG_S = 0.02, 90.0
UP = np.array([0.0, 0.0, 1.0])


def heading(ahrs: imufusion.Ahrs) -> float:
    return float(imufusion.quaternion_to_euler(ahrs.get_quaternion())[2])


def turn(ahrs: imufusion.Ahrs, duration_s: float) -> float:
    for _ in range(round(duration_s / PERIOD_S)):
        ahrs.update_no_magnetometer(np.array([0.0, 0.0, RATE_DEG_S]), UP)
    return heading(ahrs)


def at_50_hz() -> imufusion.Ahrs:
    settings = imufusion.AhrsSettings()
    settings.sample_rate = 1.0 / PERIOD_S
    ahrs = imufusion.Ahrs()
    ahrs.set_settings(settings)
    return ahrs


ahrs = at_50_hz()
during = turn(ahrs, 2.9)
assert ahrs.get_flags().startup
later = turn(ahrs, 1.1)
print(f"90 degrees a second: {during:.1f} after 2.9 s, {later:.1f} after 4 s (turned by 360)")
assert during == 0.0 and 90.0 < later < 93.0 and not ahrs.get_flags().startup
ahrs = at_50_hz()
for step in range(100):
    roll = np.radians(45.0 * (step + 1) * PERIOD_S)
    ahrs.update_no_magnetometer(np.array([45.0, 0.0, 0.0]), np.array([0.0, np.sin(roll), np.cos(roll)]))
print(f"roll after 2 s at 45 degrees a second: {imufusion.quaternion_to_euler(ahrs.get_quaternion())[0]:.1f}")
assert abs(imufusion.quaternion_to_euler(ahrs.get_quaternion())[0] - 90.0) < 2.0
ahrs = at_50_hz()
ahrs.skip_startup()
assert abs(turn(ahrs, 1.0) - 90.0) < 0.1
ahrs = at_50_hz()
ahrs.skip_startup()
ahrs.update_no_magnetometer(np.zeros(3), np.array([0.0, 0.5, 0.866]))
roll = float(imufusion.quaternion_to_euler(ahrs.get_quaternion())[0])
print(f"a robot that lies at 30 degrees, startup skipped: {roll:.1f}")
assert abs(roll) < 1.0

for first in ("settings", "period"):
    ahrs = imufusion.Ahrs()
    if first == "period":
        ahrs.set_sample_period(PERIOD_S)
    ahrs.set_settings(imufusion.AhrsSettings())
    if first == "settings":
        ahrs.set_sample_period(PERIOD_S)
    ahrs.skip_startup()
    turned = turn(ahrs, 1.0)
    print(f"{first} first: {turned:.1f} after turning by 90")
    assert abs(turned - (90.0 if first == "settings" else 45.0)) < 0.1
PY
