#!/usr/bin/env bash
# cmaes 0.13.1: a value that is not a number ranks anywhere, and the search goes astray without an error.
#
# tell sorts the solutions by value. A NaN, which a diverged simulation gives, compares as false with everything, so it
# stays where it stood and parts the list: with NaN as the first or second of six in each generation, the search walks
# away from the optimum of a parabola; as the fourth or later it does no harm. Infinity ranks last and never does.
# Whoever scores by simulation: map all that is not finite to infinity before tell.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "cmaes==0.13.1" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
from importlib.metadata import version

import numpy as np
from cmaes import CMA

assert version("cmaes") == "0.13.1"
OPTIMUM = np.array([1.0, 1.0])


def distance(place, value, generations=40):
    """From the optimum after the search, when each generation's solution at this place has this value."""
    search = CMA(mean=np.zeros(2), sigma=1.0, seed=0)
    for _ in range(generations):
        points = [search.ask() for _ in range(search.population_size)]
        values = [float(np.sum((point - OPTIMUM) ** 2)) for point in points]
        values[place] = value
        search.tell(list(zip(points, values)))
    return float(np.linalg.norm(search.mean - OPTIMUM))


astray, lost = [distance(place, float("nan")) for place in range(6)], [distance(i, float("inf")) for i in range(6)]
print("NaN as first to sixth:     ", np.round(astray, 3))
print("infinity as first to sixth:", np.round(lost, 3))
assert CMA(mean=np.zeros(2), sigma=1.0).population_size == 6
assert min(astray[:2]) > 0.5 and max(astray[3:]) < 0.01 and max(lost) < 0.01
PY
