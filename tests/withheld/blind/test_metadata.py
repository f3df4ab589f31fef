"""Logs of a healthy and of a broken robot differ in their signals alone."""

from pathlib import Path

import numpy as np
import pytest

from spot_log import read_run
from spot_model.io.model_file import save_model
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint
from withheld.blind.metadata import PAD_BYTES, features, make_alike
from withheld.plan import FaultRequest, RecordingPlan
from withheld.realities.source import source_of

RANDOM = (
    "name",
    "name as number",
    "run id, mean",
    "run id, spread",
    "began, mean",
    "began, spread",
    "first state, mean",
    "first state, spread",
)
"""Drawn from the recording's seed, which says nothing of the truth."""
KINDS = {"none": None, "flux_change": "all", "slow_queue": "body", "encoder_offset": "joint"}


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, float]]:
    sequence = VelocitySequence(
        name="ahead", duration_s=1.0, waypoints=(Waypoint(time_s=0.0), Waypoint(time_s=0.2, v_x_m_s=1.0))
    )
    found = {}
    for kind, place in KINDS.items():
        folder = tmp_path_factory.mktemp(kind)
        wanted = () if place is None else (FaultRequest(kind=kind, place=place, size=1.0),)  # type: ignore[arg-type]
        reality = source_of("calibrating").make(wanted, 7)
        reality.record(RecordingPlan(Path("policies/walk.onnx"), (sequence,), 2, 10), folder / "logs")
        make_alike(folder / "logs")
        save_model(reality.nominal, folder / "model.yaml")
        found[kind] = features(folder, [read_run(p) for p in sorted((folder / "logs").iterdir())], ["armature"])
    return found


def test_nothing_but_random_numbers_differs(given: dict[str, dict[str, float]]) -> None:
    healthy = given.pop("none")
    for kind, numbers in given.items():
        different = [n for n in healthy if numbers[n] != healthy[n] and n not in RANDOM and not n.startswith("age")]
        assert not different, kind


def test_padding_changes_sizes_and_no_signal(tmp_path: Path) -> None:
    reality = source_of("calibrating").make((), 3)
    sequence = VelocitySequence(name="ahead", duration_s=0.5, waypoints=(Waypoint(time_s=0.0),))
    reality.record(RecordingPlan(Path("policies/walk.onnx"), (sequence,), 1, 1), tmp_path)
    (path,) = tmp_path.glob("*.mcap")
    before, size = read_run(path), path.stat().st_size
    assert size % PAD_BYTES
    make_alike(tmp_path)
    after = read_run(path)
    assert path.stat().st_size % PAD_BYTES == 0
    assert not after.damage
    np.testing.assert_array_equal(after.states.load_nm, before.states.load_nm)
    np.testing.assert_array_equal(after.ticks.action, before.ticks.action)
