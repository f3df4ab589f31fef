#!/usr/bin/env bash
# POT 0.9.7.post1: the Wasserstein distance of whole numbers is zero, and one value that is not a number makes it zero.
#
# wasserstein_1d and sliced_wasserstein_distance keep the weight of a sample, one over their number, in the samples' own
# type; as a whole number it is 0. Counts of an encoder that lie 10 apart are 0 apart; with floats on one side alone 10
# becomes 9 or 11. Nothing is said. emd2 and solve_sample give 0.0 for a set with one not-a-number among 50 rows, beside
# a warning that the problem is infeasible: the best score there is, for a search that minimises it. emd2_1d is right
# for whole numbers. Whoever compares logs: convert to float64, and leave out what is not finite, before.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "POT==0.9.7.post1" "numpy==2.4.6" "scipy==1.17.1"
"$folder/venv/bin/python" - <<'PY'
import warnings
from importlib.metadata import version

import numpy as np
import ot

assert version("POT") == "0.9.7.post1"
near, far = np.array([0, 1, 2]), np.array([10, 11, 12])
floats = ot.wasserstein_1d(near.astype(float), far.astype(float))
mixed = ot.wasserstein_1d(near, far.astype(float)), ot.wasserstein_1d(near.astype(float), far)
print("10 apart: floats", floats, "- whole numbers", ot.wasserstein_1d(near, far), "- one of them", *mixed)
assert np.isclose(floats, 10.0)
assert ot.wasserstein_1d(near, far) == 0 and ot.wasserstein_1d(near, 1000 * far) == 0
assert np.allclose(mixed, [9.0, 11.0])
assert np.isclose(ot.emd2_1d(near, far, metric="euclidean"), 10.0)

a, b = np.array([[0, 1], [2, 3]]), np.array([[10, 11], [12, 13]])
sliced = [ot.sliced_wasserstein_distance(x, y, seed=0) for x, y in ((a, b), (a.astype(float), b.astype(float)))]
print("sliced: whole numbers", sliced[0], "floats", sliced[1])
assert sliced[0] == 0.0 and sliced[1] > 5.0

rng = np.random.default_rng(0)
a, b = rng.normal(size=(50, 2)), rng.normal(size=(50, 2)) + 10.0
whole = ot.emd2([], [], ot.dist(a, b))
a[7, 0] = np.nan
with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    broken = ot.emd2([], [], ot.dist(a, b)), ot.solve_sample(a, b).value
print(f"squared distance {whole:.1f}, with one value that is not a number {broken}; said: {said[0].message}")
assert whole > 150.0 and broken == (0.0, 0.0) and "infeasible" in str(said[0].message)
PY
