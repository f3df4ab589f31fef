"""Peers of the identification in lab/benchmarks/: PACE's cost has its least at the robot's own numbers."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

CLAIMS = Path(__file__).parents[2] / "lab" / "benchmarks" / "claims"


@pytest.fixture(autouse=True)
def _scripts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(CLAIMS))
    monkeypatch.setattr(sys, "path", list(sys.path))


def test_paces_cost_is_least_near_the_truth() -> None:
    import pace
    from identify_fake import truths

    truth = truths()[2]
    setpoint = pace.chirp(1.5)
    measured = pace.recorded(truth, setpoint, np.random.default_rng(0))
    friction = [truth.hip_friction_nm, truth.hip_friction_nm, truth.knee_friction_nm]
    leg = np.array([0.0403, 0.0403, 0.0731, 0.0, 0.0, 0.0, *friction, 0.0, 0.0, 0.0, 1.0])
    right = np.tile(leg, (4, 1))
    offset, heavy, late, rough = right.copy(), right.copy(), right.copy(), right.copy()
    offset[1, 11] = 0.02
    heavy[0, 2] = 0.15
    late[:, -1] = 3.0
    rough[:, 6:9] += 0.5
    costs = pace.Simulator(setpoint, measured, 5, 1).costs(np.array([right, offset, heavy, late, rough]))
    # An encoder's offset moves set-point and reading alike, and shows by gravity alone.
    assert costs[0, 1] < costs[1, 1]
    assert costs[0, 0] < 0.1 * costs[2, 0]
    assert (costs[0] < 0.1 * costs[3:].min(axis=0)).all()
    assert np.sqrt(costs[0].max()) < 0.005
    # A leg's numbers change nothing of the others.
    assert costs[2, 1:] == pytest.approx(costs[0, 1:], rel=1e-6)


def test_paces_bounds_hold_every_truth() -> None:
    import pace
    from identify_fake import truths

    low, high = pace.BOUNDS.T
    assert pace.BOUNDS.shape == (13, 2)
    for truth in truths():
        assert low[6] <= truth.hip_friction_nm <= high[6]
        assert low[8] <= truth.knee_friction_nm <= high[8]


def test_an_error_is_a_share_of_its_scale() -> None:
    import pace

    told = pace.error(np.array([[0.1, 0.3], [0.2, 0.2]]), 0.1, 0.4)
    assert told == {"true": 0.1, "found": 0.2, "error_percent": 25.0, "worst_joint_percent": 50.0}
