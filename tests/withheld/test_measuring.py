"""What the judge measures: how far a fault moves the gap, and S of a model that is right or wrong."""

from pathlib import Path

import numpy as np
import pytest

from spot_model.effects.drivetrain import TorqueGain
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.policy.policy import load_policy
from withheld.measuring import Walk, consequences, moved, record_runs, simulate, true_shrink, walk_of_run
from withheld.plan import FaultRequest, RecordingPlan

from .stand_in import StandIn

POLICY = Path("policies/walk.onnx")
SEQUENCE = VelocitySequence(
    name="ahead", duration_s=3.0, waypoints=(Waypoint(time_s=0.0), Waypoint(time_s=0.2, v_x_m_s=1.5))
)
SHORT_DRIVE = (FaultRequest(kind="flux_change", place="all", size=1.0),)


@pytest.fixture(scope="module")
def walks(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Walk]]:
    """Three walks each of a robot without a fault, of the same with new noise, and of it with a short drive."""
    asked = {"twin": ((), 1), "healthy": ((), 3), "broken": (SHORT_DRIVE, 2)}
    found = {}
    for name, (requests, seed) in asked.items():
        plan = RecordingPlan(POLICY, (SEQUENCE,), 3, seed)
        runs = record_runs(StandIn(4, requests), plan, tmp_path_factory.mktemp(name))
        assert [(r.header.command_sequence, r.header.repeat) for r in runs] == [("ahead", i) for i in range(3)]
        found[name] = [walk_of_run(run, load_policy(POLICY)) for run in runs]
    return found


def test_a_fault_moves_the_measure_and_none_does_not(walks: dict[str, list[Walk]]) -> None:
    twin = walks["twin"]
    broken, healthy = moved(walks["broken"], twin), moved(walks["healthy"], twin)
    assert broken is not None
    assert healthy is not None
    assert broken > 2.0 > 0.7 > abs(healthy)
    assert moved([], twin) is None
    top = consequences(walks["broken"], twin).top_speed.before
    assert top is not None
    assert 0.5 < top < 2.0


def test_the_right_model_shrinks_the_gap_and_a_wrong_one_does_not(tmp_path: Path) -> None:
    reality = StandIn(4, SHORT_DRIVE)
    (fault,) = reality.truth.faults
    gain = fault.parameters["torque_gain.gain"]
    policy, found = load_policy(POLICY), []
    runs = record_runs(reality, RecordingPlan(POLICY, (SEQUENCE,), 3, 2), tmp_path)
    for value in (gain, 1.0, 2.0 - gain):
        model = reality.nominal.with_effects(TorqueGain(joints=fault.joints, gain=value))
        found.append(true_shrink(runs, reality.nominal, model, policy, 5))
    right, same, wrong = found
    assert right.s is not None
    assert wrong.s is not None
    assert same.s == 0.0
    assert right.s > 0.8
    assert wrong.s < -0.3
    assert right.gaps.keys() == wrong.gaps.keys() == same.gaps.keys()
    assert "torque" in right.gaps
    for gap, s in right.gaps.items():
        assert s > 0.5 > same.gaps[gap] == 0.0 > wrong.gaps[gap]


def still(forward_m_s: float, load_nm: float, speed_rad_s: float, *, falls: bool = False, n: int = 100) -> Walk:
    signals = {
        "torque": np.full((n, 12), load_nm),
        "joint motion": np.full((n, 12), speed_rad_s),
        "body motion": np.tile([forward_m_s, 0.0, 0.0], (n, 1)),
    }
    return Walk("ahead", np.zeros((n, 36), dtype=np.float32), signals, falls)  # type: ignore[arg-type]


def test_consequences_are_speed_power_and_falls_with_and_without() -> None:
    healthy, broken = [still(1.0, 2.0, 3.0)], [still(0.7, 2.5, 3.0), still(0.5, -2.5, 3.0, falls=True)]
    found = consequences(broken, healthy)
    assert (found.top_speed.before, found.top_speed.after) == pytest.approx((1.0, 0.6))
    assert found.mean_speed.of == pytest.approx(-0.4)
    # 12 joints give 2 N·m at 3 rad/s; then 2.5 in one run, and in the other they take.
    assert (found.power.before, found.power.after) == pytest.approx((72.0, 45.0))
    assert (found.fall_share.before, found.fall_share.after) == (0.0, 0.5)


def test_runs_too_short_for_a_figure_still_count_as_falls() -> None:
    found = consequences([still(1.0, 2.0, 3.0, falls=True, n=10)], [still(1.0, 2.0, 3.0)])
    assert (found.power.of, found.fall_share.of) == (None, 1.0)


def test_simulated_loads_are_those_of_the_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a robot's load cells have them, without what friction and rotor take of the motor's torque."""
    reality, made = StandIn(4, ()), []

    def plant(effects: object, n: int, options: PlantOptions) -> Plant:
        made.append(options.mjcf)
        return Plant(effects, n, options)  # type: ignore[arg-type]

    monkeypatch.setattr("withheld.measuring.Plant", plant)
    runs = record_runs(reality, RecordingPlan(POLICY, (SEQUENCE,), 1, 2), tmp_path)
    (walk,) = simulate(reality.nominal, load_policy(POLICY), runs, np.random.default_rng(0))
    assert made[0].link_torque_sensors
    assert np.abs(walk.signals["torque"]).max() > 10.0
