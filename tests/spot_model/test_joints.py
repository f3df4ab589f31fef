from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spot_model.errors import BadInputError
from spot_model.robot.facts import JOINT_NAMES
from spot_model.robot.joints import describe_joints, select_joints


def test_groups_select_what_they_say():
    assert select_joints(["all"]).all()
    assert [n for n, m in zip(JOINT_NAMES, select_joints(["knees"]), strict=True) if m] == [
        "fl_kn",
        "fr_kn",
        "hl_kn",
        "hr_kn",
    ]
    assert select_joints(["hips"]).sum() == 8
    assert select_joints(["fl", "hr_kn"]).sum() == 4


@given(st.lists(st.booleans(), min_size=12, max_size=12).filter(any))
def test_a_description_selects_the_same_joints(flags: list[bool]):
    mask = np.array(flags)
    np.testing.assert_array_equal(select_joints(describe_joints(mask)), mask)


def test_an_unknown_name_is_refused_with_the_legal_ones():
    with pytest.raises(BadInputError, match=r"'fl_knee' is no joint or group.*fl_kn"):
        select_joints(["fl_knee"])
    with pytest.raises(BadInputError, match="empty"):
        select_joints([])
