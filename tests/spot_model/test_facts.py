from __future__ import annotations

import numpy as np
import pytest

from spot_model.robot import facts
from spot_model.robot.facts import KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM


def test_canonical_order_is_the_sdks():
    assert " ".join(facts.JOINT_NAMES) == "fl_hx fl_hy fl_kn fr_hx fr_hy fr_kn hl_hx hl_hy hl_kn hr_hx hr_hy hr_kn"


def test_masses_add_up():
    # 16.70765 + 4 · (1.13688 + 2.25620 + 0.33)
    assert pytest.approx(31.60, abs=0.001) == facts.TOTAL_MASS_KG


def test_default_pose_lies_within_the_stops_and_is_mirror_symmetric():
    pose = facts.DEFAULT_POSITION_RAD
    assert np.all(pose > facts.POSITION_LOW_RAD)
    assert np.all(pose < facts.POSITION_HIGH_RAD)
    left, right = pose[[0, 1, 2, 6, 7, 8]], pose[[3, 4, 5, 9, 10, 11]]
    np.testing.assert_array_equal(left * np.tile([-1, 1, 1], 2), right)
    assert pose[1] == 0.9
    assert pose[7] == 1.1


def test_armature_comes_from_the_gear():
    assert pytest.approx(0.0403, abs=1e-4) == facts.HIP_ARMATURE_KG_M2


@pytest.mark.parametrize(
    ("position_rad", "torque_nm"),
    [
        (-0.2471, 30.60),
        (-0.50, 60.47),
        (-1.00, 101.79),
        (-1.50, 112.98),
        (-1.80, 105.98),
        (-2.25, 81.13),
        (-2.7929, 37.17),
    ],
)
def test_knee_table_gives_the_published_torques(position_rad: float, torque_nm: float):
    assert np.interp(position_rad, KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM) == pytest.approx(torque_nm, abs=0.01)


def test_knee_table_has_101_even_rows_and_its_peak():
    assert len(KNEE_TABLE_POSITION_RAD) == 101
    np.testing.assert_allclose(np.diff(KNEE_TABLE_POSITION_RAD), 0.025458, atol=1e-9)
    peak = int(np.argmax(KNEE_TABLE_TORQUE_NM))
    assert KNEE_TABLE_POSITION_RAD[peak] == pytest.approx(-1.4436, abs=1e-4)
    assert KNEE_TABLE_TORQUE_NM[peak] == pytest.approx(113.24, abs=0.01)


def test_mirroring_twice_gives_the_link_back():
    link = facts.UPPER_LEG_FL
    assert link.mirrored(left_right=True).mirrored(left_right=True) == link
    mirrored = link.mirrored(left_right=True)
    assert mirrored.com_m[1] == -link.com_m[1]
    assert mirrored.inertia_kg_m2[3] == -link.inertia_kg_m2[3]
    assert mirrored.inertia_kg_m2[4] == link.inertia_kg_m2[4]
    assert mirrored.inertia_kg_m2[5] == -link.inertia_kg_m2[5]
