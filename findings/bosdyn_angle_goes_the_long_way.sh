#!/usr/bin/env bash
# bosdyn-client 5.2.0: the angle between two attitudes may be the long way round, 358 degrees for a turn of 2.
#
# Quat.to_axis_angle() gives an angle up to 360 degrees, about the axis that fits the sign of w, and products of
# quaternions come with either sign. A body that turns from 179 to -179 degrees of yaw has turned by 2 degrees; the
# product of one attitude's inverse with the other says 358, about the axis that points down. The rotation is the same,
# the number is none to compare with a limit. Whoever does: take min(angle, 2 pi - angle).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "bosdyn-client==5.2.0" "bosdyn-core==5.2.0" "bosdyn-api==5.2.0"
"$folder/venv/bin/python" - <<'PY'
from importlib.metadata import version
from math import degrees, isclose, pi, radians

from bosdyn.client.math_helpers import Quat

assert version("bosdyn-client") == "5.2.0"


def turn(before_deg: float, after_deg: float) -> tuple[float, float]:
    """Angle in degrees from one yaw to another, and the axis's vertical part."""
    angle, axis = (Quat.from_yaw(radians(before_deg)).inverse() * Quat.from_yaw(radians(after_deg))).to_axis_angle()
    return degrees(angle), float(axis[2])


for before_deg, after_deg, seen_deg, vertical in ((10.0, 12.0, 2.0, 1.0), (179.0, -179.0, 358.0, -1.0)):
    angle_deg, up = turn(before_deg, after_deg)
    short_deg = degrees(min(radians(angle_deg), 2.0 * pi - radians(angle_deg)))
    print(f"yaw {before_deg} to {after_deg}: {angle_deg:.1f} degrees, axis {up:.0f}; the short way {short_deg:.1f}")
    assert isclose(angle_deg, seen_deg, abs_tol=1e-6) and isclose(up, vertical, abs_tol=1e-9)
    assert isclose(short_deg, 2.0, abs_tol=1e-6)
PY
