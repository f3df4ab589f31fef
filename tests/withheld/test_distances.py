"""What the judge measures: how far a fault moves the measure, and the shrink of a model that is right or wrong."""

from pathlib import Path

import pytest

from spot_model.effects.drive.torque_gain import TorqueGain
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint
from spot_model.policy.policy import load_policy
from withheld.blind.distances import moved, read_folder, true_shrink, walks_of
from withheld.plan import FaultRequest, RecordingPlan

from .stand_in import StandIn

POLICY = Path("policies/walk.onnx")
SEQUENCE = VelocitySequence(
    name="ahead", duration_s=2.0, waypoints=(Waypoint(time_s=0.0), Waypoint(time_s=0.2, v_x_m_s=1.0))
)
SHORT_DRIVE = (FaultRequest(kind="gain", place="type", size=1.0),)


def _runs(reality: StandIn, seed: int, folder: Path) -> list:
    folder.mkdir()
    reality.record(RecordingPlan(POLICY, (SEQUENCE,), 2, seed), folder)
    return walks_of(read_folder(folder))


def test_a_fault_moves_the_measure_and_none_does_not(tmp_path: Path) -> None:
    policy = load_policy(POLICY)
    twin = _runs(StandIn(3, ()), 1, tmp_path / "twin")
    broken = moved(_runs(StandIn(3, SHORT_DRIVE), 2, tmp_path / "broken"), twin, policy)
    healthy = moved(_runs(StandIn(3, ()), 3, tmp_path / "healthy"), twin, policy)
    assert broken is not None
    assert healthy is not None
    assert broken > 2.0 > abs(healthy)
    assert moved([], twin, policy) is None


def test_the_right_model_shrinks_the_gap_and_a_wrong_one_does_not(tmp_path: Path) -> None:
    reality = StandIn(3, SHORT_DRIVE)
    found = {}
    for gain in (0.7, 1.15):
        folder = tmp_path / str(gain)
        folder.mkdir()
        model = reality.nominal.with_effects(TorqueGain(joints=("kn",), gain=gain))
        found[gain] = true_shrink(reality, model, POLICY, (SEQUENCE,), 2, 5, folder)
    assert found[0.7] == pytest.approx(1.0, abs=0.4)
    assert found[1.15] is not None
    assert found[1.15] < 0.2
