#!/usr/bin/env bash
# hyppo 0.5.2: its MMD of the same two distributions is 90 times smaller where one sample is 16 times shorter.
#
# MMD().statistic(x, y) is the MMD up to a factor, says its documentation. The factor depends on how unequal the samples
# are. Of 400 or 1,600 rows each it is 0.16 to 0.17, of 1,600 and 400 0.04, of 1,600 and 100 0.0017, while the unbiased
# MMD by its definition stays at 0.15 to 0.17. So a search that compares a simulation with robot logs of several lengths
# follows their lengths. By default the kernel's width comes from the data, too: a distance of 16 standard deviations
# gives hardly more than one of 4. The p-values are another matter. Whoever wants the number: compute it by its
# definition, with a fixed width.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "hyppo==0.5.2" "numpy==2.4.6" "scipy==1.17.1" "numba==0.68.1"
"$folder/venv/bin/python" - <<'PY'
from importlib.metadata import version

import numpy as np
from hyppo.ksample import MMD
from scipy.spatial.distance import cdist

assert version("hyppo") == "0.5.2"
rng = np.random.default_rng(0)
robot, simulated = rng.normal(size=(1600, 3)), rng.normal(1.0, 1.0, size=(1600, 3))


def unbiased_mmd(x: np.ndarray, y: np.ndarray) -> float:
    """By the definition that hyppo's documentation states, for the kernel exp(-0.5 |a - b|^2)."""
    xx, yy, xy = (np.exp(-0.5 * cdist(a, b) ** 2) for a, b in ((x, x), (y, y), (x, y)))
    n, m = len(x), len(y)
    return float((xx.sum() - n) / n / (n - 1) + (yy.sum() - m) / m / (m - 1) - 2.0 * xy.mean())


factors = {}
for n, m in ((1600, 1600), (400, 400), (1600, 400), (1600, 100)):
    theirs, plain = MMD(gamma=0.5).statistic(robot[:n], simulated[:m]), unbiased_mmd(robot[:n], simulated[:m])
    factors[n, m] = theirs / plain
    print(f"{n} and {m} rows: hyppo {theirs:.5f}, by the definition {plain:.3f}, factor {factors[n, m]:.4f}")
    assert 0.15 < plain < 0.17
assert 0.15 < factors[400, 400] < 0.18 and 0.15 < factors[1600, 1600] < 0.18
assert factors[1600, 1600] > 3.0 * factors[1600, 400] > 60.0 * factors[1600, 100]

near, far, farther = (MMD().statistic(robot[:200], robot[200:400] + d) for d in (1.0, 4.0, 16.0))
print(f"1, 4 and 16 standard deviations apart: {near:.3f}, {far:.3f}, {farther:.3f}")
assert far > 2.0 * near and farther < 1.05 * far
PY
