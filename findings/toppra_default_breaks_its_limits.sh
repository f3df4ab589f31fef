#!/usr/bin/env bash
# toppra 0.6.10: with its defaults, 19 of 20 trajectories exceed the accelerations that they were given, by up to 24 %.
#
# TOPPRA finds the fastest speed along a path at grid points, and its default parametrizer joins them by a cubic spline,
# which bends harder in between. Of 60 random paths of three joints under 5 rad/s2, 57 ask for over 5.25, one for 6.2;
# 1,000 grid points change little, and no result says so. parametrizer="ParametrizeConstAccel" keeps the limit to 0.2 %.
# Whoever sends such a path to a robot: name the parametrizer, and check the second derivative.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "toppra==0.6.10" "numpy==2.4.6" "scipy==1.17.1"
"$folder/venv/bin/python" - <<'PY'
from importlib.metadata import version

import numpy as np
import toppra
from toppra.algorithm import TOPPRA
from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint

assert version("toppra") == "0.6.10"
toppra.setup_logging("ERROR")
SPEED, ACCELERATION, PATHS = 2.0, 5.0, 60


def largest(seed: int, **options: str | int) -> tuple[float, float]:
    """Speed and acceleration of the trajectory along a random path, at 4,000 times."""
    corners = np.random.default_rng(seed).uniform(-1.0, 1.0, (5, 3))
    path = toppra.SplineInterpolator(np.linspace(0.0, 1.0, 5), corners)
    limits = [
        JointVelocityConstraint(SPEED * np.array([[-1.0, 1.0]] * 3)),
        JointAccelerationConstraint(ACCELERATION * np.array([[-1.0, 1.0]] * 3)),
    ]
    trajectory = TOPPRA(limits, path, **options).compute_trajectory(0.0, 0.0)
    times = np.linspace(0.0, trajectory.duration, 4000)
    return float(np.abs(trajectory(times, 1)).max()), float(np.abs(trajectory(times, 2)).max())


for options in ({}, {"gridpt_min_nb_points": 1000}, {"parametrizer": "ParametrizeConstAccel"}):
    speeds, accelerations = np.array([largest(seed, **options) for seed in range(PATHS)]).T
    over = int((accelerations > 1.05 * ACCELERATION).sum())
    print(f"{options}: accelerations up to {accelerations.max():.2f}, {over} of {PATHS} over 5.25; ", end="")
    print(f"speeds up to {speeds.max():.3f}")
    assert speeds.max() < 1.01 * SPEED
    if "parametrizer" in options:
        assert over == 0 and accelerations.max() < 1.002 * ACCELERATION
    else:
        assert over >= 55 and accelerations.max() > 1.15 * ACCELERATION
PY
