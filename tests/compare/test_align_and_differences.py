"""Alignment by the commands, and differences worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from compare.align import aligned, shift
from compare.compare import Comparison
from compare.differences import differences
from compare.errors import DifferentCommandsError, TooShortError
from compare.ghost import _place
from compare.page import comparison_page, sentence
from compare.tracks import STEP_S


def test_a_run_that_does_the_same_later_is_brought_to_one_clock(make_track) -> None:
    reference, late = make_track(), make_track("late", 500, late_s=0.5)
    assert shift(reference, late) == round(0.5 / STEP_S)
    assert shift(late, reference) == -round(0.5 / STEP_S)
    for tracks in ([reference, late], [late, reference]):
        a, b = aligned(tracks)
        assert len(a) == len(b)
        np.testing.assert_array_equal(a.velocity_command, b.velocity_command)
        np.testing.assert_allclose(a.position_rad, b.position_rad, atol=1e-9)


def test_a_command_that_never_changes_is_not_shifted(make_track) -> None:
    a, b = make_track(n=200), make_track(n=200)
    a.velocity_command[:], b.velocity_command[:] = 1.0, 1.0
    assert shift(a, b) == 0


def test_runs_that_were_told_other_things_are_refused(make_track) -> None:
    other = make_track("other")
    other.velocity_command[:] = [-1.0, 0.5, 0.0]
    with pytest.raises(DifferentCommandsError, match=r"log and other follow different velocity commands.*simulated"):
        aligned([make_track(), other])


def test_runs_that_share_too_little_are_refused(make_track) -> None:
    with pytest.raises(TooShortError, match=r"at least 1 s"):
        aligned([make_track(n=60), make_track(n=60)])


def test_a_run_beside_itself_differs_in_nothing(make_track) -> None:
    found = differences(make_track(), make_track("again"))
    for signal in found.signals.values():
        assert not signal.rms.any()
        assert not signal.distance.any()
    assert found.end_distance_m == 0.0
    assert "Every joint does the same" in sentence(make_track(), found)


def test_an_offset_is_its_own_distance_and_rms(make_track) -> None:
    found = differences(make_track(), make_track("off", offset_rad=0.25))
    np.testing.assert_allclose(found.signals["position_rad"].rms, 0.25)
    np.testing.assert_allclose(found.signals["position_rad"].distance, 0.25)
    np.testing.assert_allclose(found.signals["position_rad"].over_time, 0.25)
    np.testing.assert_allclose(found.signals["velocity_rad_s"].rms, 0.0, atol=1e-9)


def test_a_wave_out_of_step_differs_in_rms_and_hardly_in_distribution(make_track) -> None:
    # Half a period late: a sine against its negative. rms of the difference 2·0.1/√2; the values are the same ones.
    found = differences(make_track(n=400), make_track("late", n=400, late_s=0.5))
    position = found.signals["position_rad"]
    np.testing.assert_allclose(position.rms, 0.2 / np.sqrt(2.0), rtol=1e-3)
    assert (position.distance < 1e-3).all()


def test_bodies_are_compared_from_where_they_start_and_look(make_track) -> None:
    assert differences(make_track(), make_track(heading_rad=2.0)).end_distance_m == pytest.approx(0.0, abs=1e-9)
    # 3.99 s at 1 and at 1.5 m/s.
    assert differences(make_track(), make_track(speed_m_s=1.5)).end_distance_m == pytest.approx(0.5 * 3.99)


def test_a_ghost_starts_beside_the_robot_and_goes_its_way(make_track) -> None:
    reference, ghost = make_track(heading_rad=np.pi / 2), make_track(heading_rad=-1.0)
    position, attitude = _place(ghost, reference, 0.7)
    # The robot looks along +y, so its left is −x.
    np.testing.assert_allclose(position[0], reference.position_of_body_in_odom_m[0] + [-0.7, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(position[-1] - position[0], [0.0, 3.99, 0.0], atol=1e-9)
    np.testing.assert_allclose(attitude, reference.odom_from_body_wxyz, atol=1e-12)


def test_a_signal_that_one_run_lacks_is_no_difference(make_track) -> None:
    other = make_track("other")
    other.load_nm[:] = np.nan
    reference = make_track()
    found = differences(reference, other)
    assert np.isnan(found.signals["load_nm"].rms).all()
    assert not found.signals["load_nm"].share.any()
    page = comparison_page([reference, other], [found], [], "", [])
    assert "nan" not in page.lower().replace("nano", "")
    assert Comparison((reference, other), (found,)).to_json()["runs"][0]["signals"]["load_nm"]["rms"]["fl_hx"] is None
