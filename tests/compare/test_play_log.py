"""``spot-rl play LOG``: the recorded walk, the model's, and what a diagnosis found, in a browser too."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compare.play_command import play, policy_or_log
from compare.play_log import LogToPlay, switches_of
from compare.tracks import CompareError
from diagnosis.document import Number, Verdict
from spot_log.read.run import Run
from spot_model.effects.base import Effect
from spot_model.effects.friction import CoulombFriction
from spot_model.errors import BadInputError
from spot_model.io.model_file import load_model
from spot_model.robot import facts
from spot_model.robot.mjcf import default_height_m
from tests.browser import CHROMIUM, Page
from tests.diagnosis import report_case
from tests.diagnosis.planted import POLICY
from trainer.play.replay import ReplayPage, Simulations, Walked
from trainer.play.scene import WebServer
from trainer.play.switches import BUILT_IN, Found

Effects = tuple[Effect, ...]


@pytest.fixture(scope="module")
def run() -> Run:
    return report_case.runs(load_model("paper_identified"), 1)[0]


@pytest.fixture(scope="module")
def verdict() -> Verdict:
    return report_case.a_diagnosis().verdict


def silent(_: float) -> None:
    """Nothing is told."""


def test_the_recorded_robot_and_the_model_start_on_the_ground_and_walk_on_the_same_grid(run: Run) -> None:
    played = LogToPlay.of(run, policy=POLICY)
    recorded, model = played.recorded(), played.simulate(played.model.effects, "", silent)
    for walked in (recorded, model):
        assert walked.qpos[0, 2] == pytest.approx(default_height_m(), abs=0.01)
        assert walked.qpos.shape == (len(walked.forward_m_s), 19)
        np.testing.assert_allclose(np.linalg.norm(walked.qpos[:, 3:7], axis=1), 1.0, atol=1e-6)
    assert played.offered is BUILT_IN
    assert played.model_name == "paper_identified"
    assert recorded.told == ""
    assert "The robot moves at " in model.told
    np.testing.assert_array_equal(model.qpos, played.simulate(played.model.effects, "", silent).qpos)
    stiff = played.simulate((CoulombFriction(joints=("knees",), level_nm=5.0),), "friction", silent)
    assert stiff.words == "paper_identified with friction"
    assert np.abs(stiff.qpos[50:100, 7:] - model.qpos[50:100, 7:]).max() > 0.01


def test_a_walk_stays_where_it_ended() -> None:
    qpos = np.arange(3.0)[:, None] * np.ones(19)
    walked = Walked("a", "", 0.01, qpos, np.zeros(3), np.zeros((3, 0), dtype=np.bool_))
    assert walked.end_s == pytest.approx(0.02)
    assert [walked.at(t)[0] for t in (0.0, 0.011, 0.02, 9.0)] == [0.0, 1.0, 2.0, 2.0]


def test_what_a_diagnosis_found_is_added_to_the_models_effects(verdict: Verdict) -> None:
    (found,) = switches_of(verdict)
    value = verdict.differences[0].by_type["kn"]["level_nm"].value
    assert found.words.startswith("dry friction at fl_kn: ")
    own = load_model("ideal").effects
    (effect,) = found.change(1.0)(own)
    assert isinstance(effect, CoulombFriction)
    assert effect.joints == ("fl_kn",)
    assert effect.level_nm == value


def test_numbers_by_joint_type_become_an_effect_each(verdict: Verdict) -> None:
    knee = {"level_nm": Number(value=2.0, low=1.0, high=3.0)}
    change = {"joints": facts.JOINT_NAMES, "by_type": {"kn": knee}}
    difference = verdict.differences[0].model_copy(update=change)
    (found,) = switches_of(verdict.model_copy(update={"differences": (difference,)}))
    hips, thighs, knees = found.change(1.0)(())
    assert [e.level_nm for e in (hips, thighs, knees)] == [difference.parameters["level_nm"].value] * 2 + [2.0]
    assert knees.joints == ("fl_kn", "fr_kn", "hl_kn", "hr_kn")


def test_a_finding_outside_the_library_is_not_offered(verdict: Verdict) -> None:
    difference = verdict.differences[0].model_copy(update={"name": "of_somebody"})
    assert switches_of(verdict.model_copy(update={"differences": (difference,)})) == ()


def test_a_log_without_a_known_policy_names_the_next_step(run: Run) -> None:
    unknown = replace(run, header=replace(run.header, policy_sha256="0" * 64))
    with pytest.raises(CompareError, match="--policy FILE"):
        LogToPlay.of(unknown)


def test_a_diagnosis_whose_model_is_gone_names_the_next_step(run: Run, verdict: Verdict) -> None:
    with pytest.raises(CompareError, match=r"'nominal\.yaml' is not a file.*--model"):
        LogToPlay.of(run, policy=POLICY, verdict=verdict)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"velocity": "1,0,0"}, "leave out --velocity"),
        ({"video": Path("a.mp4")}, "leave out --video"),
    ],
)
def test_options_that_a_log_does_not_have_are_refused(words: dict[str, object], message: str, tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=message):
        play(tmp_path / "a.mcap", **words)


def test_a_log_that_is_not_there_is_called_a_log() -> None:
    with pytest.raises(BadInputError, match=r"log 'nowhere\.mcap' does not exist .*\*\.mcap"):
        policy_or_log("nowhere.mcap")


def a_walk(words: str) -> Walked:
    n = 200
    qpos = np.zeros((n, 19))
    qpos[:, 0], qpos[:, 2], qpos[:, 3] = np.linspace(0.0, 1.0, n), default_height_m(), 1.0
    qpos[:, 7:] = facts.DEFAULT_POSITION_RAD
    return Walked(words, "", 0.01, qpos, np.full(n, 0.5), np.ones((n, 4), dtype=np.bool_))


def until(holds: Callable[[], bool]) -> None:
    """Wait for as long as the test may take."""
    while not holds():
        threading.Event().wait(0.005)


def test_only_what_is_wanted_last_is_simulated_to_its_end_and_errors_are_told() -> None:
    begun, goes_on = threading.Event(), threading.Event()

    def simulate(effects: Effects, words: str, tell: Callable[[float], None]) -> Walked:
        if words == "bad":
            raise BadInputError("cannot be simulated")
        if words == "first":
            begun.set()
            goes_on.wait()
        tell(0.5)
        return a_walk(words)

    simulations = Simulations(simulate)
    simulations.want((), "first")
    begun.wait()
    simulations.want((), "second")
    goes_on.set()
    got: list[Walked | None] = []
    until(lambda: got.extend(simulations.news()) or any(got))
    assert [walked and walked.words for walked in got] == [None, None, "second"]
    simulations.want((), "bad")
    until(lambda: simulations.told == "bad: cannot be simulated")
    simulations.want((), "")
    until(lambda: simulations.told == "")
    assert simulations.news() == [None, None]


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason="no headless Chromium is installed")
def test_a_browser_shows_a_log_and_switches_a_finding_on(tmp_path: Path) -> None:
    added = CoulombFriction(joints=("knees",), level_nm=1.0)
    asked: list[Effects] = []

    def simulate(effects: Effects, words: str, tell: Callable[[float], None]) -> Walked:
        asked.append(effects)
        return a_walk(f"the model with {words}")

    server, is_over = WebServer("127.0.0.1", 0), threading.Event()
    walks = [a_walk("as recorded"), a_walk("the model alone")]
    shown = ReplayPage(server, walks, (), [Found("dry friction", lambda effects: (*effects, added))], simulate)

    def show() -> None:
        while not is_over.wait(0.01):
            shown.advance(0.02)

    thread = threading.Thread(target=show)
    thread.start()
    try:
        with Page(f"http://127.0.0.1:{server.get_port()}", tmp_path / "profile") as page:
            page.wait_for("!!document.querySelector('canvas')")
            page.wait_for("document.body.innerText.includes('the model alone')")
            page.click("dry friction", "label")
            page.wait_for("document.body.innerText.includes('the model with dry friction')")
            page.click("dry friction", "label")
            page.wait_for("!document.body.innerText.includes('the model with dry friction')")
    finally:
        is_over.set()
        thread.join()
        server.stop()
    assert asked == [(added,)]
    assert shown.scene.frame_rate_hz > 0.0
