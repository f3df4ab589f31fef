#!/usr/bin/env bash
# evo 1.38.1: where poses come in bursts, one pose of the reference is paired with several, and each counts as one.
#
# associate_trajectories takes the nearest stamp for each pose of the shorter trajectory, and forgets that it was taken.
# Three poses of an estimate within 20 ms are all compared with the same pose of the reference; the pair that comes out
# has the same stamp three times. The mean error counts that moment three times, what the robot moved meanwhile is an
# error, and so the associated reference no longer passes evo's own check; speeds of it raise an error. Whoever compares
# a robot with a bursty recorder: look for repeated stamps after the association, and keep the nearest.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "evo==1.38.1" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
from importlib.metadata import version

import numpy as np
from evo.core import sync
from evo.core.metrics import APE, PoseRelation
from evo.core.trajectory import PoseTrajectory3D

assert version("evo") == "1.38.1"


def straight(stamps):
    """A robot that walks at 1 m/s along x: its place is its time."""
    stamps = np.array(stamps)
    places = np.column_stack([stamps, 0.0 * stamps, 0.0 * stamps])
    return PoseTrajectory3D(places, np.tile([1.0, 0.0, 0.0, 0.0], (len(stamps), 1)), stamps)


reference = straight([0.0, 0.1, 0.2, 0.3, 0.4])
bursts = straight([0.091, 0.1, 0.109, 0.3])
a, b = sync.associate_trajectories(reference, bursts, max_diff=0.02)
print("paired:", a.timestamps, "with", b.timestamps)
assert a.timestamps.tolist() == [0.1, 0.1, 0.1, 0.3] and b.timestamps.tolist() == [0.091, 0.1, 0.109, 0.3]

error = APE(PoseRelation.translation_part)
error.process_data((a, b))
print("errors of a trajectory without any:", error.error)
assert np.allclose(error.error, [0.009, 0.0, 0.009, 0.0])
good, said = a.check()
print("check of the reference:", said["timestamps"])
assert reference.check()[0] and not good
PY
