from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from spot_model.errors import BadInputError
from spot_model.io.velocity_sequence import (
    BUILT_IN,
    VelocitySequence,
    Waypoint,
    forward_sequence,
    load_sequence,
    random_sequence,
    save_sequence,
    six_directions_sequence,
)


def test_forward_ramps_to_the_top_holds_and_stops():
    sequence = forward_sequence(4.0)
    np.testing.assert_allclose(sequence.at(0.5), [0, 0, 0])
    np.testing.assert_allclose(sequence.at(6.0), [2.0, 0, 0])
    np.testing.assert_allclose(sequence.at(13.0), [4.0, 0, 0])
    np.testing.assert_allclose(sequence.at(99.0), [0, 0, 0])


def test_six_directions_visits_each_once():
    commands = {tuple(np.sign(six_directions_sequence().at(t))) for t in np.arange(0.0, 20.0, 0.1)}
    assert commands == {(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)}


def test_random_is_reproducible_and_within_bounds():
    assert random_sequence(3) == random_sequence(3)
    assert random_sequence(3) != random_sequence(4)
    drawn = random_sequence(3).sampled(50.0)
    assert drawn.shape == (1000, 3)
    assert np.all(np.abs(drawn) <= [3.0, 1.0, 1.5])


def test_clipping_keeps_to_the_range():
    clipped = forward_sequence(4.0).clipped(np.array([-0.5, -0.5, -1.0]), np.array([1.5, 0.5, 1.0]))
    assert clipped.sampled(50.0)[:, 0].max() == 1.5
    assert clipped.name == "forward"


@pytest.mark.parametrize("name", BUILT_IN)
def test_file_round_trip(name: str, tmp_path: Path):
    sequence = load_sequence(name)
    save_sequence(sequence, tmp_path / "s.yaml")
    assert load_sequence(str(tmp_path / "s.yaml")) == sequence
    with pytest.raises(BadInputError, match="exists"):
        save_sequence(sequence, tmp_path / "s.yaml")


def test_bad_files_are_refused_in_words(tmp_path: Path):
    file = tmp_path / "s.yaml"
    with pytest.raises(BadInputError, match="is not a file; allowed: a YAML file, or one of forward"):
        load_sequence(str(file))
    file.write_text("schema: spot-rl/velocity-sequence/1\nname: x\nduration_s: 3\nwaypoints: [{time_s: 0, v_x: 1}]\n")
    with pytest.raises(BadInputError, match=r"waypoints\.0\.v_x"):
        load_sequence(str(file))
    for odd in ("true", "'1'", ".nan", "1e308", "1 m/s"):
        file.write_text(f"name: x\nduration_s: 3\nwaypoints: [{{time_s: 0, v_x_m_s: {odd}}}]\n")
        with pytest.raises(BadInputError, match=r"waypoints\.0\.v_x_m_s = "):
            load_sequence(str(file))
    file.write_text("{")
    with pytest.raises(BadInputError, match="is not valid YAML"):
        load_sequence(str(file))
    with pytest.raises(ValueError, match="must start at 0 and rise"):
        VelocitySequence(name="x", duration_s=3.0, waypoints=(Waypoint(time_s=1.0),))
