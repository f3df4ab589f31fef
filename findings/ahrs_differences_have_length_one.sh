#!/usr/bin/env bash
# ahrs 0.4.0: sums and differences of its quaternions are normalised, so an error always has length one.
#
# Quaternion is a NumPy array of four numbers whose + and - go through its constructor, which divides by the length. The
# difference of two rotations that are 0.2 rad apart is as long as that of two that are 2 rad apart, and the difference
# of equal ones raises "Quaternion cannot be a zero vector". So norm(p - q), the usual error of an attitude filter, is 1
# for every estimate, and np.allclose of two Quaternions raises. NumPy's own functions, as np.subtract, give the plain
# numbers, though the type is the same. Whoever compares: take np.array(p) first.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "AHRS==0.4.0" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
from importlib.metadata import version

import numpy as np
from ahrs import Quaternion

assert version("AHRS") == "0.4.0"
still = Quaternion([1.0, 0.0, 0.0, 0.0])
for angle in (0.002, 0.2, 2.0):
    turned = Quaternion([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])
    plain = np.linalg.norm(np.array(turned) - np.array(still))
    print(f"{angle} rad apart: norm(p - q) {np.linalg.norm(turned - still):.6f}, of plain arrays {plain:.6f}")
    assert np.isclose(np.linalg.norm(turned - still), 1.0)
    assert np.isclose(plain, 2.0 * np.sin(angle / 4))
    assert np.isclose(np.linalg.norm(turned + still), 1.0)
    assert np.isclose(np.linalg.norm(np.array(np.subtract(turned, still))), plain)
equal = Quaternion([1.0, 0.0, 0.0, 0.0])
for compare in (lambda: still - equal, lambda: np.allclose(still, equal)):
    try:
        compare()
    except ValueError as error:
        print("equal ones:", error)
    else:
        raise AssertionError("equal quaternions can be compared now")
PY
