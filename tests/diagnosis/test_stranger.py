"""Whole diagnoses of robots of another hand: friction, load cells, link and estimator share no formula with ours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from diagnosis.channels import ChannelView
from diagnosis.channels.actuator import actuator_view
from diagnosis.channels.sensors import rate_view
from diagnosis.channels.stack import stacked
from diagnosis.library.registry import LIBRARY
from diagnosis.report.output import write_all
from diagnosis.verdict.diagnose import Diagnosis, diagnose_runs
from diagnosis.verdict.possible_robots import ROBOTS
from spot_model.effects.commands import CommandDelay
from spot_model.io.model_file import RobotModel, load_model
from spot_model.io.models_file import load_models
from spot_model.policy.policy import load_policy
from trainer.signals.recording import record

from .stranger import SEQUENCES, Errors, Faults, Stranger, thinned, uneven

POLICY = Path(__file__).parents[2] / "policies" / "walk.onnx"
NOMINAL = RobotModel((CommandDelay(delay_s=0.004),))
EXACT = Errors(gain=0.02, mass=0.03, load_lag_s=(0.001, 0.0011), friction_nm=(0.02, 0.1), estimator_lag_s=(0.0, 0.005))
"""Nearly as a maker would sign it; what the defaults of :class:`Errors` are is an old robot."""
SLOW = {"slow": ((0, 0, 0, 0), (0.1, 0.25, 0, 0), (1, 0.3, 0, 0))}
SHORT = {name: SEQUENCES[name] for name in ("forward", "turn")}


def _diagnosed(robot: Stranger) -> Diagnosis:
    runs = robot.walk(SHORT, 2, 4.0)
    return diagnose_runs(runs, NOMINAL, robot.policy, np.random.default_rng(0), lambda _: None)


@pytest.mark.slow
def test_a_robot_with_nothing_wrong_has_no_gap(tmp_path: Path) -> None:
    found = _diagnosed(Stranger(load_policy(POLICY), 11, errors=EXACT))
    assert found.verdict.status in ("no_gap", "calibration")
    assert found.verdict.differences == ()
    assert found.verdict.where
    paths = write_all(found, tmp_path / "out", LIBRARY)
    # The file holds this robot's own gains, joint by joint, as numbers.
    assert any(e.name == "torque_gain" for e in load_model(str(paths["model"])).effects)
    # Robots that the logs allow: the fitted one first, then others whose calibration is drawn.
    fitted, *robots = load_models(str(paths["robots"]))
    assert fitted == load_model(str(paths["model"]))
    gains = [[e.values["gain"] for e in r.effects if e.name == "torque_gain"] for r in robots]
    assert len(robots) == ROBOTS
    assert len({tuple(g) for g in gains}) == ROBOTS


@pytest.mark.slow
def test_one_weak_joint_is_named_and_nothing_else() -> None:
    found = _diagnosed(Stranger(load_policy(POLICY), 102, Faults(gain={"hl_kn": 0.6}), EXACT))
    assert [(e.name, e.joints) for e in found.verdict.differences] == [("torque_gain", ("hl_kn",))]
    gain = found.verdict.differences[0].parameters["gain"]
    assert gain.low < 0.6 < gain.high


@pytest.mark.slow
def test_one_run_without_the_policy_proves_nothing_and_still_says_where() -> None:
    robot = Stranger(load_policy(POLICY), 102, Faults(gain={"hl_kn": 0.6}), EXACT)
    runs = robot.walk({"forward": SEQUENCES["forward"]}, 1, 3.0)
    found = diagnose_runs(runs, NOMINAL, None, np.random.default_rng(0), lambda _: None)
    assert all(e.probability <= 0.9 for e in found.verdict.differences)
    assert found.verdict.where[0].joint == "hl_kn"


@pytest.mark.slow
def test_a_short_slow_walk_at_uneven_55_hz_gets_no_confident_cause() -> None:
    """One run, no receipts, contacts, policy or battery: what is left of a real recording."""
    for seed in (2, 5):
        run = Stranger(load_policy(POLICY), seed).walk(SLOW, 1, 3.2)
        coarse = thinned(run[0], uneven(len(run[0].states), np.random.default_rng(seed)))
        verdict = diagnose_runs([coarse], NOMINAL, None, np.random.default_rng(0), lambda _: None).verdict
        assert all(e.probability <= 0.5 for e in verdict.differences), verdict.differences
        assert verdict.probability_unknown < 0.5
        assert "a state every 18 ms says too little of accelerations" in verdict.channels["base_wrench"]
        assert "payload_mass" in verdict.invisible


def test_uneven_logs_of_one_recorder_have_one_rate_and_velocities_that_fit_their_positions() -> None:
    """Steps of 6 and 9 ms, of which one log has more of the one, and another more of the other."""
    rng = np.random.default_rng(1)
    runs = Stranger(load_policy(POLICY), 1).walk(SLOW, 2, 2.5)
    logs = []
    for run, share in zip(runs, (0.45, 0.55), strict=True):
        at = np.cumsum(np.where(rng.random(len(run.states)) < share, 2, 3))
        logs.append(record(thinned(run, at[at < len(run.states)])))
    medians = [np.median(np.diff(log.stamp_ns)) for log in logs]
    assert medians[0] != medians[1]
    view = rate_view(stacked(logs), 0.0)
    even = rate_view(stacked([record(run) for run in runs]), 0.0)
    left, usual = (np.sqrt(np.mean(v.response[v.usable] ** 2)) for v in (view, even))
    assert left < 1.5 * usual


def test_an_uneven_log_leaves_no_more_of_the_load_than_the_whole_stream() -> None:
    run = Stranger(load_policy(POLICY), 1).walk(SLOW, 1, 2.5)[0]
    coarse = thinned(run, uneven(len(run.states), np.random.default_rng(1)))
    left = []
    for log in (run, coarse):
        view = actuator_view(stacked([record(log)]), ())
        assert isinstance(view, ChannelView)
        left.append(np.sqrt(np.mean(view.response[view.usable] ** 2)))
    assert left[1] < 1.3 * left[0]
