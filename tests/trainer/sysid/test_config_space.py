from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spot_model.errors import BadInputError
from spot_model.robot import facts
from trainer.sysid.config import SysidConfig, load_sysid_config, sysid_config_from_data

SPACE = SysidConfig().space()


def test_the_default_is_the_papers_search() -> None:
    config = SysidConfig()
    assert (config.search.generations, config.search.population) == (100, 10)
    assert SPACE.n == 8
    start = facts.PAPER_INITIAL
    assert SPACE.initial.tolist() == [
        start.hip_friction_nm,
        start.knee_friction_nm,
        start.torque_max_nm,
        start.torque_min_nm,
        start.speed_max_rad_s,
        start.speed_min_rad_s,
        start.intersect_max_rad_s,
        start.intersect_min_rad_s,
    ]


@given(st.lists(st.floats(0.0, 1.0), min_size=8, max_size=8))
def test_the_unit_cube_holds_only_allowed_models(unit: list[float]) -> None:
    values = SPACE.values_of_unit(np.array(unit))
    SPACE.model_with(values)
    assert SPACE.unit_of_values(values) == pytest.approx(np.array(unit), abs=1e-12)


def test_each_candidate_has_its_own_row_of_simulations() -> None:
    values = np.stack([SPACE.initial, SPACE.initial + np.array([0.5, 0.5, 1, -1, 1, -1, 1, -1])])
    effects = SPACE.effects(values, sims_per_candidate=3)
    assert effects[0].level_nm.ravel().tolist() == [0.0, 0.0, 0.0, 0.5, 0.5, 0.5]  # type: ignore[attr-defined]


def test_the_found_model_holds_single_numbers() -> None:
    values = SPACE.initial.copy()
    values[1] = 0.25
    data = SPACE.model_with(values).to_data()
    assert data["effects"][1] == {"effect": "coulomb_friction", "joints": ["knees"], "level_nm": 0.25}


def test_any_parameter_of_any_effect_can_be_searched(tmp_path: Path) -> None:
    (tmp_path / "model.yaml").write_text(
        "schema: spot-rl/model/1\nrobot: spot\neffects:\n  - {effect: payload_mass, mass_kg: 1.0}\n"
    )
    (tmp_path / "sysid.yaml").write_text(
        f"model: {tmp_path / 'model.yaml'}\nparameters:\n"
        "  - {effect: payload_mass, joints: [all], parameter: mass_kg, initial: 0, low: -2, high: 10}\n"
    )
    assert load_sysid_config(tmp_path / "sysid.yaml").space().names == ("payload_mass[all].mass_kg",)


ENTRY = {
    "effect": "coulomb_friction",
    "joints": ["knees"],
    "parameter": "level_nm",
    "initial": 0.1,
    "low": 0,
    "high": 1,
}


@pytest.mark.parametrize(
    ("data", "text"),
    [
        ({"parameters": [ENTRY | {"effect": "gravity"}]}, "effect 'gravity' is unknown; allowed: action_scale"),
        ({"parameters": [ENTRY | {"parameter": "size"}]}, "no parameter 'size'; allowed: level_nm"),
        ({"parameters": [ENTRY | {"low": -1}]}, "bounds -1 to 1; coulomb_friction.level_nm allows 0 to 5"),
        ({"parameters": [ENTRY | {"low": 1}]}, "low must be below high"),
        ({"parameters": [ENTRY | {"initial": 2}]}, "initial = 2; allowed: 0 to 1"),
        ({"parameters": [ENTRY | {"fraction_of": "speed"}]}, "fraction_of = 'speed'; allowed: another searched param"),
        ({"parameters": [ENTRY, ENTRY]}, "is listed twice"),
        ({"search": {"generation": 3}}, r"config x:\n.*search\.generation"),
    ],
)
def test_what_cannot_be_searched_is_named(data: dict[str, object], text: str) -> None:
    with pytest.raises(BadInputError, match=text):
        sysid_config_from_data(data, source="config x").space()
    with pytest.raises(BadInputError, match=r"config none\.yaml cannot be read"):
        load_sysid_config(Path("none.yaml"))


def test_a_searched_effect_that_the_model_lacks_is_added_at_null() -> None:
    entry = {"effect": "payload_mass", "parameter": "mass_kg", "initial": 1, "low": 0, "high": 9}
    space = sysid_config_from_data({"model": "paper_identified", "parameters": [entry]}, source="x").space()
    assert space.model.effects[-1].name == "payload_mass"
    assert space.model.effects[-1].is_null
    # An effect that is there on other joints is not doubled unasked.
    with pytest.raises(BadInputError, match=r"has no effect 'coulomb_friction' on joints \['all'\]; it has: "):
        sysid_config_from_data(
            {"model": "paper_identified", "parameters": [ENTRY | {"joints": ["all"]}]}, source="x"
        ).space()
