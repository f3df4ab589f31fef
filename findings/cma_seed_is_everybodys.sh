#!/usr/bin/env bash
# cma 4.5.0: a search's seed sets NumPy's global generator, so two searches side by side draw from the last one's seed.
#
# The option seed of CMAEvolutionStrategy is given to numpy.random, and ask() draws from there. Where a second search is
# made before the first one asks, the first has the second's numbers, not those that it had alone. The rest of the
# program is seeded as well: noise that is drawn after each start of a search with that seed is the same noise. seed=0
# is no seed but the clock. Whoever fits several robots in one process: one search after the other, and a generator of
# one's own, as np.random.default_rng(seed), for everything else.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "cma==4.5.0" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
from importlib.metadata import version

import cma
import numpy as np

assert version("cma") == "4.5.0"


def search(seed: int) -> cma.CMAEvolutionStrategy:
    return cma.CMAEvolutionStrategy([0.5] * 4, 0.3, {"seed": seed, "verbose": -9})


def first(strategy: cma.CMAEvolutionStrategy) -> np.ndarray:
    return np.array(strategy.ask())


alone = {seed: first(search(seed)) for seed in (1, 2)}
assert np.array_equal(alone[1], first(search(1))) and not np.allclose(alone[1], alone[2])
one, _two = search(1), search(2)
beside = first(one)
print("seed 1 beside seed 2 draws as seed 2:", np.allclose(beside, alone[2]))
assert np.allclose(beside, alone[2]) and not np.allclose(beside, alone[1])

noise = []
for _ in range(2):
    search(1)
    noise.append(np.random.rand(3))
print("noise of the program after each start:", *noise)
assert np.array_equal(*noise)
own = np.random.default_rng(1)
noise = [(search(1), own.random(3))[1] for _ in range(2)]
assert not np.allclose(*noise)

clock = first(search(0)), first(search(0))
print("seed 0 twice, the same:", np.allclose(*clock))
assert not np.allclose(*clock)
PY
