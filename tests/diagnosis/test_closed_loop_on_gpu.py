"""A closed loop of the diagnosis on mujoco_warp, which computes on the cores here."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest

from spot_model.io.model_file import load_model
from spot_model.policy.policy import load_policy
from trainer.simulate.recorded_runs import UsualNoise, simulate_scripts

from .planted import POLICY, scripts

# What takes seconds to import waits for the tests that need it: every worker collects every file.
pytestmark = pytest.mark.skipif(find_spec("mujoco_warp") is None, reason="mujoco_warp is not installed (extra gpu)")

SILENT = UsualNoise(0.0, 0.0, 0.0, 0.0, 0.0)


def test_a_run_is_the_same_on_both() -> None:
    model, policy = load_model("paper_identified"), load_policy(POLICY)
    runs = {
        device: simulate_scripts(model, policy, scripts(10), np.random.default_rng(0), SILENT, device=device)
        for device in ("cpu", "warp-cpu")
    }
    for cores, warp in zip(runs["cpu"], runs["warp-cpu"], strict=True):
        np.testing.assert_allclose(warp.states.position_rad, cores.states.position_rad, atol=1e-5)
        np.testing.assert_array_equal(warp.states.last_command_key, cores.states.last_command_key)
        stamps = [s.last_command_robot_stamp_ns for s in (warp.states, cores.states)]
        np.testing.assert_array_equal(*stamps)
        assert [run.header.run_id for run in (warp, cores)] == [cores.header.run_id] * 2


@pytest.mark.slow
def test_walks_are_as_near_to_those_on_the_cores_as_these_to_each_other() -> None:
    """Steps that a rounding brings forward lead runs apart; what they do in four seconds stays the same."""
    from benchmarks import gpu_parity

    found = gpu_parity.walks("warp-cpu", n=3, seconds=4.0)
    assert 0.0 < found["w1_to_cores_nm"] < 1.3 * found["w1_floor_nm"]
