import pytest

from diagnosis.extra_effect import chosen_library
from diagnosis.library.registry import LIBRARY
from spot_model.errors import BadInputError


def test_left_out_effects_are_not_tried_and_twice_is_once() -> None:
    names = ["coulomb_friction", "torque_gain", "coulomb_friction"]
    assert set(chosen_library([], names)) == set(LIBRARY) - set(names)
    assert set(chosen_library([], [])) == set(LIBRARY)


def test_an_unknown_name_names_the_allowed_ones() -> None:
    with pytest.raises(BadInputError, match=r"--without 'friction' is not in the library; allowed: .*coulomb_friction"):
        chosen_library([], ["friction"])


def test_nothing_left_is_an_error() -> None:
    with pytest.raises(BadInputError, match="library is empty"):
        chosen_library([], list(LIBRARY))
