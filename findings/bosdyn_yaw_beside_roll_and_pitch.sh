#!/usr/bin/env bash
# bosdyn-client 5.2.0: the yaw that a quaternion gives is not the one that belongs to its roll and its pitch.
#
# Quat.to_roll and Quat.to_pitch are Euler angles in the order Z, Y, X; Quat.to_yaw is the turn about the vertical axis
# that comes nearest to the whole rotation. On level ground both are the same. A robot whose heading is 28.6 degrees
# reads 25.1 where it pitches by 23 and rolls by 17, and the three angles put together again are 3.5 degrees off.
# SE3Pose.get_closest_se2_transform takes the same yaw; its name says so. Whoever needs the heading, or all three:
# quat_to_eulerZYX of the same module gives angles that belong together.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "bosdyn-client==5.2.0" "bosdyn-core==5.2.0" "bosdyn-api==5.2.0"
"$folder/venv/bin/python" - <<'PY'
from importlib.metadata import version
from math import acos, atan2, degrees

from bosdyn.client.math_helpers import Quat, SE3Pose, quat_to_eulerZYX

assert version("bosdyn-client") == "5.2.0"


def rotation(yaw, pitch, roll):
    """First roll, then pitch, then yaw, about the world's axes."""
    return Quat.from_yaw(yaw) * Quat.from_pitch(pitch) * Quat.from_roll(roll)


def apart(a, b):
    """Angle between two rotations, in degrees."""
    return degrees(2.0 * acos(min(1.0, abs((a.inverse() * b).w))))


flat = rotation(0.5, 0.0, 0.0)
assert abs(flat.to_yaw() - 0.5) < 1e-12

tilted = rotation(0.5, 0.4, 0.3)
x, y, _ = tilted.transform_point(1.0, 0.0, 0.0)
heading, own = degrees(atan2(y, x)), degrees(tilted.to_yaw())
again = rotation(tilted.to_yaw(), tilted.to_pitch(), tilted.to_roll())
print(f"heading {heading:.1f} degrees, to_yaw {own:.1f}; the three angles together are {apart(tilted, again):.1f} off")
assert abs(tilted.to_roll() - 0.3) < 1e-9 and abs(tilted.to_pitch() - 0.4) < 1e-9
assert abs(heading - 28.65) < 0.01 and abs(own - 25.14) < 0.01
assert 3.0 < apart(tilted, again) < 4.0

yaw, pitch, roll = quat_to_eulerZYX(tilted)
assert apart(tilted, rotation(yaw, pitch, roll)) < 1e-4 and abs(yaw - 0.5) < 1e-9
pose = SE3Pose(0.0, 0.0, 0.0, tilted)
assert abs(pose.get_closest_se2_transform().angle - tilted.to_yaw()) < 1e-12
PY
