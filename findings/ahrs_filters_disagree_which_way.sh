#!/usr/bin/env bash
# ahrs 0.4.0: one filter turns the other way round than its neighbours, and one never turns about the vertical.
#
# All filters take the same arrays and leave quaternions in Q. For a body rolled by 0.3 rad, Tilt, Madgwick, Mahony, EKF
# and Complementary say +0.3 about x, AQUA -0.3: its Q turns the world into the body's frame. For one that turns about
# the vertical at 0.5 rad/s, without a magnetometer, Complementary stays at yaw 0 for any gain, also for gain 1, which
# by its documentation uses the gyroscope only; the others follow the gyroscope. Whoever exchanges filters: conjugate
# AQUA's Q, and give Complementary a magnetometer.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "AHRS==0.4.0" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
from importlib.metadata import version

import numpy as np
from ahrs import filters

assert version("AHRS") == "0.4.0"
N, G, RATE = 300, 9.81, 100.0


def last(name, gyroscope, accelerometer, **more):
    """Rotation vector at the end, rad; only one of its numbers is not zero here."""
    q = np.array(getattr(filters, name)(gyr=gyroscope, acc=accelerometer, frequency=RATE, **more).Q)[-1]
    q = q if q[0] >= 0.0 else -q
    return 2.0 * np.arctan2(q[1:], q[0])


still = np.zeros((N, 3))
rolled = np.tile([0.0, G * np.sin(0.3), G * np.cos(0.3)], (N, 1))
turning, level = np.tile([0.0, 0.0, 0.5], (N, 1)), np.tile([0.0, 0.0, G], (N, 1))
for name in ("Madgwick", "Mahony", "EKF", "Complementary", "AQUA"):
    roll, yaw = last(name, still, rolled)[0], last(name, turning, level)[2]
    print(f"{name:<14} rolled by 0.3 rad: {roll:+.3f}; turned by {0.5 * N / RATE} rad: {yaw:+.3f}")
    assert np.isclose(roll, -0.3 if name == "AQUA" else 0.3, atol=0.01)
    assert np.isclose(yaw, {"AQUA": -1.5, "Complementary": 0.0}.get(name, 1.5), atol=0.02)
assert last("Complementary", turning, level, gain=1.0)[2] == 0.0
PY
