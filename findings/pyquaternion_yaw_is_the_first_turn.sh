#!/usr/bin/env bash
# pyquaternion 0.9.9: yaw_pitch_roll are the angles of another order; a tilted robot's yaw is not its heading.
#
# "Intrinsic Tait-Bryan angles following the z-y'-x'' convention", says the documentation, which is yaw, then pitch,
# then roll about axes that turn along. What comes is the matrix that it states below: R_x(roll) R_y(pitch) R_z(yaw), in
# which the yaw turns first. On level ground it is the same. A heading of 28.6 degrees reads 23.8 where the robot
# pitches by 22.9 and rolls by 17.2, and the roll reads 5.3. Whoever wants z-y'-x'': the yaw is atan2(R[1, 0], R[0, 0])
# of rotation_matrix.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "pyquaternion==0.9.9" "scipy==1.17.1" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
from importlib.metadata import version

import numpy as np
from pyquaternion import Quaternion
from scipy.spatial.transform import Rotation

assert version("pyquaternion") == "0.9.9"
level = Quaternion(axis=[0, 0, 1], radians=0.5)
assert np.allclose(level.yaw_pitch_roll, [0.5, 0.0, 0.0])

yaw, pitch, roll = 0.5, 0.4, 0.3
turns = zip(np.eye(3)[::-1], (yaw, pitch, roll), strict=True)  # about z, y and x
about_z, about_y, about_x = (Quaternion(axis=axis, radians=angle) for axis, angle in turns)
tilted = about_z * about_y * about_x
nose = tilted.rotate([1.0, 0.0, 0.0])
own = np.array(tilted.yaw_pitch_roll)
print("made of", np.degrees([yaw, pitch, roll]).round(1), "degrees, yaw_pitch_roll says", np.degrees(own).round(1))
assert np.isclose(np.arctan2(nose[1], nose[0]), yaw)
matrix = Rotation.from_matrix(tilted.rotation_matrix)
assert np.allclose(matrix.as_euler("ZYX"), [yaw, pitch, roll])
assert np.allclose(matrix.as_euler("XYZ")[::-1], own)
assert np.allclose(np.degrees(own), [23.8, 27.9, 5.3], atol=0.1)

# The angles belong to the order in which the yaw turns first.
x, y, z = (Rotation.from_euler(axis, angle) for axis, angle in zip("xyz", own[::-1], strict=True))
assert np.allclose((x * y * z).as_matrix(), tilted.rotation_matrix)
assert not np.allclose((z * y * x).as_matrix(), tilted.rotation_matrix, atol=0.05)
PY
