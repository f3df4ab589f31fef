from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from spot_model.effects.torque_limits import TorqueLimit
from spot_model.errors import BadInputError
from spot_model.io.model_file import BUILT_IN, RobotModel, load_model, model_from_data, save_model


@pytest.mark.parametrize("name", BUILT_IN)
def test_file_round_trip(name: str, tmp_path: Path):
    model = load_model(name)
    save_model(model, tmp_path / "m.yaml")
    again = load_model(str(tmp_path / "m.yaml"))
    assert again == model
    assert again.digest() == model.digest()
    with pytest.raises(BadInputError, match="exists"):
        save_model(model, tmp_path / "m.yaml")


def test_the_paper_s_two_models():
    curve = load_model("paper_identified").effects[3].values
    assert curve["torque_max_nm"] == 97.00
    assert curve["intersect_min_rad_s"] == -8.32
    initial = load_model("paper_initial").effects
    assert initial[0].is_null
    assert initial[3].values["speed_max_rad_s"] == 20.0
    assert initial[5].values["delay_s"] == 0.005


def test_an_array_does_not_go_into_a_file():
    with pytest.raises(ValueError, match=r"limit_nm has shape \(2, 1\)"):
        RobotModel((TorqueLimit(limit_nm=np.array([[1.0], [2.0]])),)).to_data()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"effects": [{"joints": ["all"]}]}, "effects.0 has no key 'effect'"),
        (
            {"effects": [{"effect": "torque_limit", "limit_nm": 0.1}]},
            r"effects\.0: torque_limit\.limit_nm = 0\.1; allowed",
        ),
        ({"effect": []}, "effect = "),
        ({"robot": "anymal"}, "robot = 'anymal'"),
        ([], "m: "),
    ],
)
def test_bad_data_is_refused_in_words(data, message: str):
    with pytest.raises(BadInputError, match=message):
        model_from_data(data, source="m: ")


def test_no_such_model():
    with pytest.raises(BadInputError, match="'nothing' is not a file; allowed: a YAML file, or one of ideal"):
        load_model("nothing")
