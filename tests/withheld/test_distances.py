"""What the judge measures: how far a fault moves the gap, and S of a model that is right or wrong."""

from pathlib import Path

import pytest

from spot_log import read_run
from spot_model.effects.drive.torque_gain import TorqueGain
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint
from spot_model.policy.policy import load_policy
from withheld.measuring.distances import Written, moved, true_shrink
from withheld.plan import FaultRequest, RecordingPlan, Walk

from .stand_in import Alone, StandIn

POLICY = Path("policies/walk.onnx")
SEQUENCE = VelocitySequence(
    name="ahead", duration_s=3.0, waypoints=(Waypoint(time_s=0.0), Waypoint(time_s=0.2, v_x_m_s=1.5))
)
SHORT_DRIVE = (FaultRequest(kind="flux_change", place="all", size=1.0),)


def _walks(requests: tuple[FaultRequest, ...], seed: int) -> list[Walk]:
    plan = RecordingPlan(POLICY, (SEQUENCE,), 3, seed)
    return StandIn(4, requests).make_runs(plan).walks(load_policy(POLICY))


def test_a_fault_moves_the_measure_and_none_does_not() -> None:
    twin = _walks((), 1)
    broken, healthy = moved(_walks(SHORT_DRIVE, 2), twin), moved(_walks((), 3), twin)
    assert broken is not None
    assert healthy is not None
    assert broken > 2.0 > 0.7 > abs(healthy)
    assert moved([], twin) is None


def test_logs_and_runs_in_memory_are_the_same_walks(tmp_path: Path) -> None:
    plan = RecordingPlan(POLICY, (SEQUENCE,), 1, 5)
    policy = load_policy(POLICY)
    ((name, written),) = Written(Alone(4, SHORT_DRIVE), plan, tmp_path).walks(policy)
    ((other, in_memory),) = StandIn(4, SHORT_DRIVE).make_runs(plan).walks(policy)
    assert name == other == "ahead"
    assert written == pytest.approx(in_memory)


def test_the_right_model_shrinks_the_gap_and_a_wrong_one_does_not(tmp_path: Path) -> None:
    reality = StandIn(4, SHORT_DRIVE)
    (fault,) = reality.truth.faults
    gain = fault.parameters["torque_gain.gain"]
    policy, found = load_policy(POLICY), []
    reality.record(RecordingPlan(POLICY, (SEQUENCE,), 3, 2), tmp_path)
    runs = [read_run(path) for path in sorted(tmp_path.glob("*.mcap"))]
    for value in (gain, 1.0, 2.0 - gain):
        model = reality.nominal.with_effects(TorqueGain(joints=fault.joints, gain=value))
        found.append(true_shrink(runs, reality.nominal, model, policy, 5))
    right, same, wrong = found
    assert right is not None
    assert wrong is not None
    assert same == 0.0
    assert right > 0.8
    assert wrong < -0.3
