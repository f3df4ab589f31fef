"""Laws that hold for every fault of the catalogue."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.library.registry import LIBRARY
from spot_model.robot.facts import JOINT_NAMES
from tests.withheld.realities.quick import faulty, healthy, request, short_run
from withheld.plan import FaultRequest
from withheld.realities.calibrating.catalogue import CATALOGUE
from withheld.realities.reality import make
from withheld.simulator.recording.run_arrays import RunArrays

SIGNALS = (
    "position_rad", "velocity_rad_s", "load_nm", "position_of_body_in_odom_m", "odom_from_body_wxyz",
    "linear_vel_of_body_in_odom_m_s", "angular_vel_of_body_in_odom_rad_s", "foot_contact", "imu_acceleration_m_s2",
    "imu_turn_rad_s", "arrival_ns", "setpoint_rad", "requested_rad", "battery_v", "battery_a", "winding_c",
)
IN_THE_LIBRARY = [name for name, kind in CATALOGUE.items() if kind.names]
STRANGE = [name for name, kind in CATALOGUE.items() if not kind.names]


def differing(run: RunArrays, other: RunArrays) -> set[str]:
    """Signals that are not the same bit for bit."""
    return {name for name in SIGNALS if not np.array_equal(getattr(run, name), getattr(other, name))}


def test_all_faults_of_size_zero_together_change_no_bit() -> None:
    assert differing(short_run([request(name, 0.0) for name in CATALOGUE]), healthy()) == set()


@pytest.mark.parametrize("name", CATALOGUE)
def test_a_fault_of_full_size_changes_the_log_and_breaks_no_number(name: str) -> None:
    run = faulty(name)
    assert np.isfinite(run.load_nm).all()
    assert np.isfinite(run.position_rad).all()
    assert differing(run, healthy())


@pytest.mark.parametrize("name", IN_THE_LIBRARY)
def test_what_the_truth_names_is_in_the_library(name: str) -> None:
    kind = CATALOGUE[name]
    assert set(kind.names) <= set(LIBRARY)
    truth = make([request(name, 0.7)], 1).truth.faults[0]
    for parameter in truth.parameters:
        effect, value = parameter.split(".")
        assert effect in kind.names
        assert value in {p.name for p in LIBRARY[effect].effect.parameters()}


def test_enough_faults_are_strange_to_the_library() -> None:
    assert len(STRANGE) >= 7
    for name in STRANGE:
        assert make([request(name)], 1).truth.faults[0].parameters == {}


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_place_of_a_kind_can_be_asked_for(name: str) -> None:
    for place in CATALOGUE[name].places:
        for seed in range(3):
            (fault,) = make([FaultRequest(kind=name, place=place, size=0.5)], seed).truth.faults
            assert set(fault.joints) <= set(JOINT_NAMES)
            assert (fault.joints == ()) == (place == "body")
            if place == "joint":
                assert len(fault.joints) == 1


def test_every_effect_of_the_library_has_a_fault() -> None:
    covered = {name for kind in CATALOGUE.values() for name in kind.names}
    assert set(LIBRARY) - covered == set()


def test_an_unknown_fault_and_a_wrong_place_are_refused() -> None:
    with pytest.raises(ValueError, match=r"fault 'rust' is unknown; allowed: bent_shaft"):
        make([FaultRequest(kind="rust", place="joint", size=1.0)], 0)
    with pytest.raises(ValueError, match=r"headwind cannot act at place 'joint'; allowed: body"):
        make([FaultRequest(kind="headwind", place="joint", size=1.0)], 0)
