"""The Python API: what its reference promises, and what it says where it is used wrongly."""

from __future__ import annotations

import dataclasses
import json
import multiprocessing
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

import spot_rl
from diagnosis.library.registry import LIBRARY
from spot_log.read.run import Run
from spot_model.console.command_line import main

from .conftest import REPOSITORY, WALK


def test_importing_the_library_loads_nothing_heavy() -> None:
    told = subprocess.run(
        [sys.executable, "-c", "import spot_rl, sys; print(sorted({'torch', 'mujoco', 'numpy'} & set(sys.modules)))"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert told.stdout.strip() == "[]"


def test_every_name_is_there_and_documented() -> None:
    assert set(spot_rl.__all__) == set(dir(spot_rl)) == set(spot_rl._WHERE)
    for name in spot_rl.__all__:
        assert (getattr(spot_rl, name).__doc__ or "").strip(), name
    with pytest.raises(AttributeError, match=r"no attribute 'reed_run'; it has .*read_run"):
        _ = spot_rl.reed_run


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(spot_rl._WHERE, "make_env", ("no_such_module", "gym"))
    with pytest.raises(ImportError, match=r"make_env needs the module 'no_such_module'.*spot-rl\[gym\]"):
        _ = spot_rl.make_env


@pytest.mark.slow
def test_a_walk_is_arrays_and_frames(walks: list[Run]) -> None:
    run = walks[0]
    assert run.outcome == "completed"
    assert run.states.position_rad.shape == (len(run.states), 12)
    frame = run.to_pandas()
    assert len(frame) == len(run.states)
    assert frame.index[0] == 0.0
    np.testing.assert_array_equal(frame["load_nm.fl_kn"], run.states.load_nm[:, 2])
    ticks = run.to_pandas("tick")
    assert ticks["velocity_command.x_m_s"].max() == pytest.approx(0.8)
    with pytest.raises(spot_rl.SpotRlError, match=r"topic 'joints' is not in a log; allowed: state, imu"):
        run.to_pandas("joints")


def test_a_simulated_run_follows_the_same_commands(walks: list[Run], in_project: None) -> None:
    simulated = spot_rl.simulate(walks[0], "paper_identified", seed=3)
    again = spot_rl.simulate(walks[0], spot_rl.load_model("paper_identified"), policy=WALK, seed=3)
    np.testing.assert_array_equal(simulated.states.position_rad, again.states.position_rad)
    assert simulated.to_pandas("tick")["velocity_command.x_m_s"].iloc[-1] == pytest.approx(0.8)
    other = spot_rl.simulate(walks[0], "paper_identified", seed=4)
    assert not np.array_equal(simulated.states.position_rad, other.states.position_rad)


def test_a_comparison_is_a_page_and_a_ghost(walks: list[Run], in_project: None, tmp_path: Path) -> None:
    runs = [*walks, spot_rl.simulate(walks[0], "ideal")]
    found = spot_rl.compare(runs, tmp_path / "side-by-side", names=["first", "second", "ideal"])
    *told, compared = found.sentences
    assert compared.startswith("Compared: ")
    for sentence, name in zip(told, ("second", "ideal"), strict=True):
        assert sentence.startswith("first moves at 0.")
        assert f", {name} at 0." in sentence
    # The same robot twice is nearer to itself than to a model without its friction, limits and rotors.
    assert found.differences[0].largest[2] < found.differences[1].largest[2]
    page = (tmp_path / "side-by-side" / "compare.html").read_text(encoding="utf-8")
    assert len(page) < 1_500_000
    assert "http" not in page.replace("http://www.w3.org", "")
    with (tmp_path / "side-by-side" / "compare.mcap").open("rb") as file:
        messages = {}
        for _, channel, _, message in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            messages.setdefault(channel.topic, []).append(message)
    frames = {t.child_frame_id for t in messages["/tf"][0].transforms}
    assert {"body", "fl_kn", "ghost/body", "ghost/fl_kn", "ghost2/hr_hx"} <= frames
    assert {e.frame_id for e in messages["/scene"][0].entities} <= frames
    assert len(messages["/ghost/difference"]) == len(messages["/joint_states"])
    with pytest.raises(spot_rl.SpotRlError, match=r"nothing is overwritten"):
        spot_rl.compare(runs, tmp_path / "side-by-side")


def test_the_command_compares_logs_and_models(
    walks: list[Run], in_project: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = str(walks[0].path)
    with pytest.raises(SystemExit) as left:
        main(["compare", log, "paper_identified", "--out", str(tmp_path / "out")])
    assert left.value.code in (0, None)
    assert ", paper_identified at 0." in capsys.readouterr().out
    figures = json.loads((tmp_path / "out" / "compare.json").read_text(encoding="utf-8"))
    assert figures["reference"] == "walk held_0.8_0_0 r0"
    for words, told in (
        (["paper_identified", log], "the first run must be a log"),
        ([log, "nothing"], "'nothing' is not a file; allowed: a log"),
        ([log, log, "--verdict", str(tmp_path)], "cannot be read"),
    ):
        with pytest.raises(SystemExit) as left:
            main(["compare", *words, "--out", str(tmp_path / "other")])
        assert left.value.code == 2
        assert told in capsys.readouterr().err
        assert not (tmp_path / "other").exists()


def test_a_model_takes_more_effects() -> None:
    plain = spot_rl.load_model("paper_identified")
    more = spot_rl.load_model("paper_identified", effects=[{"effect": "payload_mass", "mass_kg": 8.0}])
    assert more.effects[: len(plain.effects)] == plain.effects
    assert [(e.name, e.mass_kg) for e in more.effects[len(plain.effects) :]] == [("payload_mass", 8.0)]


def test_a_model_takes_effects_of_a_class_and_names_them_so_that_others_find_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(str(REPOSITORY / "examples"))
    from oil_drag import OilDrag

    model = spot_rl.load_model("ideal", effects=[OilDrag(joints=("knees",), drag=0.1), {"effect": "armature"}])
    data = model.to_data()
    assert [effect["effect"] for effect in data["effects"]] == ["oil_drag:OilDrag", "armature"]
    assert spot_rl.load_model("ideal", effects=data["effects"]).effects == model.effects


def test_a_policy_is_given_as_a_file_or_as_it_was_loaded(in_project: None, tmp_path: Path) -> None:
    policy = spot_rl.load_policy(WALK)
    with pytest.raises(spot_rl.SpotRlError, match=r"the fake robot is not running"):
        spot_rl.FakeSpot().walk(policy)
    unnamed = dataclasses.replace(policy, path=None)
    with pytest.raises(spot_rl.SpotRlError, match=r"was not loaded from a file; give the path"):
        spot_rl.FakeSpot().walk(unnamed)


def test_the_environment_is_seeded_and_ends_once(in_project: None) -> None:
    env = gymnasium.make("spot_rl.environment:spot_rl/Velocity-v0", changes={"noise.scale": 0.0})
    still = np.zeros(12, dtype=np.float32)

    def first(seed: int) -> np.ndarray:
        env.reset(seed=seed, options={"command": (1.0, 0.0, 0.0)})
        return np.array([env.step(still)[0] for _ in range(3)])

    np.testing.assert_array_equal(first(5), first(5))
    assert not np.array_equal(first(5), first(6))
    assert (first(5)[:, 9:12] == [1.0, 0.0, 0.0]).all()
    env.reset(seed=5, options={})
    policy_free = np.full(12, 0.6, dtype=np.float32)  # a pose that nobody stands in
    for _ in range(500):
        observation, _, fell, timed_out, _ = env.step(policy_free)
        if fell or timed_out:
            break
    assert fell
    assert np.isfinite(observation).all()
    with pytest.raises(spot_rl.SpotRlError, match=r"call reset\(\) first"):
        env.unwrapped.step(still)


def test_a_worker_that_imports_the_script_is_told_why_it_may_not_identify(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(multiprocessing.current_process(), "_inheriting", True, raising=False)
    with pytest.raises(spot_rl.SpotRlError, match=r'under if __name__ == "__main__":, or give workers=1'):
        spot_rl.identify("logs", WALK, "out")


def test_an_environment_takes_a_model_with_effects(in_project: None) -> None:
    rubs = {"effect": "coulomb_friction", "joints": ["knees"], "level_nm": 5.0}
    rubbing = spot_rl.load_model("paper_identified", effects=[rubs])
    named, given, other = (
        spot_rl.make_env(model=m) for m in ("paper_identified", spot_rl.load_model("paper_identified"), rubbing)
    )
    seen = []
    for env in (named, given, other):
        env.reset(seed=5, options={"command": (0.5, 0.0, 0.0)})
        seen.append([env.step(np.full(12, 0.5, dtype=np.float32))[0] for _ in range(5)])
    np.testing.assert_array_equal(seen[0], seen[1])
    assert np.abs(np.subtract(seen[0], seen[2])).max() > 0.01


def test_the_walking_policy_walks_in_the_environment(in_project: None) -> None:
    env = spot_rl.make_env(changes={"noise.scale": 0.0}, raw_actions=True)
    policy = spot_rl.load_policy(WALK)
    observation, _ = env.reset(seed=1, options={"command": (1.0, 0.0, 0.0)})
    speeds = []
    for _ in range(150):
        observation, _, fell, _, _ = env.step(policy.act(observation))
        assert not fell
        speeds.append(observation[0])
    assert np.mean(speeds[-50:]) == pytest.approx(1.0, abs=0.15)


def test_a_program_of_the_vendors_sdk_finds_the_fake() -> None:
    program = """
import sys
from bosdyn.client import create_standard_sdk, util
robot = create_standard_sdk("program").create_robot(sys.argv[1])
util.authenticate(robot)
print(robot.get_id().serial_number)
"""
    with spot_rl.FakeSpot(lock_step=False) as spot:
        words = [sys.executable, "-c", program, spot.sdk_host]
        told = subprocess.run(words, env={**os.environ, **spot.environment}, capture_output=True, text=True)
    assert told.stdout.startswith("spot-FAKE"), told.stderr


def test_a_policy_is_trained_and_exported(in_project: None, tmp_path: Path) -> None:
    small = {"iterations": 1, "n_envs": 8, "ppo.hidden": [16, 8], "ppo.steps_per_iteration": 6}
    run = spot_rl.train(REPOSITORY / "policies" / "walk.yaml", tmp_path / "run", changes=small)
    policy = spot_rl.load_policy(spot_rl.export(run, tmp_path / "mine.onnx", name="mine"))
    assert policy.contract.name == "mine"
    assert policy.act(np.zeros(48)).shape == (12,)


def test_a_diagnosis_made_in_python_can_be_continued(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from diagnosis.session import INPUTS, DiagnosisRequest
    from spot_model.io.model_file import load_model

    def at_once(inputs: Any, out: Path, *_: Any, **__: Any) -> Any:
        out.mkdir()
        inputs.save(out)
        return SimpleNamespace(verdict="done", simulated={}, runs=()), {}

    monkeypatch.setattr("spot_rl.analysis.run_session", at_once)
    model = spot_rl.load_model("paper_identified")
    assert spot_rl.diagnose(WALK, model, tmp_path / "gap", without="armature") == "done"
    inputs = DiagnosisRequest.model_validate_json((tmp_path / "gap" / INPUTS).read_bytes())
    assert (inputs.logs, inputs.without) == ((str(Path(WALK).absolute()),), ("armature",))
    assert load_model(inputs.nominal) == model
    spot_rl.diagnose(WALK, "ideal", tmp_path / "other")
    assert DiagnosisRequest.model_validate_json((tmp_path / "other" / INPUTS).read_bytes()).nominal == "ideal"


@pytest.mark.slow
def test_python_and_the_command_write_the_same_folder(walks: list[Run], in_project: None, tmp_path: Path) -> None:
    log, less = str(walks[0].path), [name for name in LIBRARY if name != "coulomb_friction"]
    spot_rl.diagnose(log, "paper_identified", tmp_path / "python", policy=WALK, without=less)
    words = ["diagnose", log, "--nominal", "paper_identified", "--policy", str(WALK)]
    with pytest.raises(SystemExit) as left:
        main([*words, *(w for name in less for w in ("--without", name)), "--out", str(tmp_path / "command")])
    assert left.value.code in (0, None)
    ours, theirs = (
        {str(p.relative_to(tmp_path / name)): p for p in sorted((tmp_path / name).rglob("*"))}
        for name in ("python", "command")
    )
    assert set(ours) == set(theirs)
    assert {"inputs.json", "report.html", "possible_robots.yaml", "compare/compare.html"} <= set(ours)
    for name in ("inputs.json", "verdict.json", "possible_robots.yaml"):
        assert ours[name].read_text() == theirs[name].read_text()
