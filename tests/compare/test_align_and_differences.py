"""Alignment by the commands, and differences worked out by hand."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from compare.cause import check_verdict
from compare.compare import Comparison
from compare.differences import differences
from compare.ghost import placed_beside
from compare.page import comparison_page, difference_sentence, stretch
from compare.tracks import STEP_S, CompareError, aligned_tracks, shift
from diagnosis.document import Verdict


def test_a_run_that_does_the_same_later_is_brought_to_one_clock(make_track) -> None:
    reference, late = make_track(), make_track("late", 500, late_s=0.5)
    assert shift(reference, late) == round(0.5 / STEP_S)
    assert shift(late, reference) == -round(0.5 / STEP_S)
    for tracks in ([reference, late], [late, reference]):
        a, b = aligned_tracks(tracks)
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
    with pytest.raises(CompareError, match=r"log and other follow different velocity commands.*simulated"):
        aligned_tracks([make_track(), other])


@pytest.mark.parametrize(("axis", "words"), [(0, "m/s forward"), (1, "m/s to the left"), (2, "rad/s turning")])
@pytest.mark.parametrize("rows", [slice(200, 230), slice(None)])
def test_one_axis_for_a_moment_is_another_command(make_track, axis: int, words: str, rows: slice) -> None:
    """A mean over axes and time would hide 0.3 m/s in one of them, and 0.3 s of anything."""
    other = make_track("other")
    other.velocity_command[rows, axis] += 0.3
    for tracks in ([make_track(), other], [other, make_track()]):
        with pytest.raises(CompareError, match=rf"{words}; 0.15 apart is allowed"):
            aligned_tracks(tracks)


def test_commands_of_one_sequence_that_come_a_tick_early_or_late_are_the_same(make_track) -> None:
    other = make_track("other")
    other.velocity_command[95:101, 0] = 1.0
    other.velocity_command[:, 1] += 0.1
    assert shift(make_track(), other) in range(-8, 9)


def test_what_is_cut_is_told(make_track) -> None:
    tracks = aligned_tracks([make_track(n=400), make_track("short", n=300)])
    assert stretch(tracks) == "Compared: 3.0 of 4.0 s of log; all 3.0 s of short."
    assert stretch(aligned_tracks([make_track(), make_track("again")])) == "Compared: all 4.0 s of each run."
    fell = dataclasses.replace(make_track("model", n=300), fell=True)
    found = Comparison(tuple(aligned_tracks([make_track(), fell])), ())
    assert found.sentences[-1] == "Compared: 3.0 of 4.0 s of log; all 3.0 s of model, which falls."
    assert found.to_json()["compared"] == found.sentences[-1]


def test_each_run_is_close_or_not_for_itself(make_track) -> None:
    log, close, far = make_track(), make_track("corrected", offset_rad=0.005), make_track("nominal", offset_rad=0.05)
    both = [differences(log, run) for run in (close, far)]
    assert "7.1 % of its standard deviation (close, below 10 %)" in difference_sentence(log, both[0])
    assert "70.7 % of its standard deviation (close would be below 10 %)" in difference_sentence(log, both[1])
    page = comparison_page([log, close, far], both, [], "", [])
    assert "Some close" in page
    assert "log moves like corrected, and differently from nominal" in page
    assert "badge bad" not in page
    assert ">Apart<" in comparison_page([log, far], both[1:], [], "", [])
    assert ">Close<" in comparison_page([log, close], both[:1], [], "", [])


def test_runs_without_a_common_signal_are_not_said_to_do_the_same(make_track) -> None:
    other = make_track("other")
    for name in ("position_rad", "velocity_rad_s", "load_nm"):
        getattr(other, name)[:] = np.nan
    found = differences(make_track(), other)
    assert difference_sentence(make_track(), found).endswith("log and other have no joint signal in common.")
    assert ">Apart<" in comparison_page([make_track(), other], [found], [], "", [])


def test_a_diagnosis_of_other_logs_marks_nothing() -> None:
    verdict = Verdict.model_construct(logs=("/there/a.mcap", "b.mcap"), timeline=())
    run = SimpleNamespace(path=Path("/here/a.mcap"), header=SimpleNamespace(run_id="1"))
    check_verdict(verdict, Path("gap"), run)
    run.path = Path("/here/c.mcap")
    with pytest.raises(CompareError, match=r"gap is of other logs \(a.mcap and 1 more\) than /here/c.mcap"):
        check_verdict(verdict, Path("gap"), run)


def test_runs_that_share_too_little_are_refused(make_track) -> None:
    with pytest.raises(CompareError, match=r"at least 1 s"):
        aligned_tracks([make_track(n=60), make_track(n=60)])


def test_a_run_beside_itself_differs_in_nothing(make_track) -> None:
    found = differences(make_track(), make_track("again"))
    for signal in found.signals.values():
        assert not signal.rms.any()
        assert not signal.distance.any()
    assert found.end_distance_m == 0.0
    assert "All joints move alike" in difference_sentence(make_track(), found)


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
    position, attitude = placed_beside(ghost, reference, 0.7)
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
