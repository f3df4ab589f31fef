"""What is wrong with an argument is said in one sentence of ours, and nothing is left on the disk."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import spot_rl
from spot_log.read.run import Run

from .conftest import BRISK, WALK

NAN = math.nan
TINY = {"name": "x", "iterations": 1, "n_envs": 2}
NETWORK = torch.nn.Linear(48, 12)


@pytest.fixture(scope="module")
def robot() -> Iterator[spot_rl.FakeSpot]:
    with spot_rl.FakeSpot(BRISK) as spot:
        yield spot


@pytest.fixture(scope="module")
def run(robot: spot_rl.FakeSpot) -> Run:
    return robot.walk("walk", duration_s=1.0)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder: a file, a folder, and files that are not what their names say."""
    (tmp_path / "text").write_text("text", encoding="utf-8")
    (tmp_path / "folder").mkdir()
    (tmp_path / "junk.onnx").write_bytes(b"junk")
    (tmp_path / "junk.yaml").write_text(": : [", encoding="utf-8")
    (tmp_path / "junk.mcap").write_bytes(b"junk")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refuses(call: Callable[[], Any], told: str, folder: Path) -> None:
    before = sorted(folder.rglob("*"))
    with pytest.raises(spot_rl.SpotRlError, match=told):
        call()
    assert sorted(folder.rglob("*")) == before, "something was left"


PATHS = "allowed: a path, as text or pathlib.Path"
POLICIES = "allowed: a built-in name, the path of an ONNX file"
MODELS = "allowed: a built-in name, the path of a model file"


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda s: s.read_run(None), f"log = None; {PATHS}"),
        (lambda s: s.read_run(""), f"log = ''; {PATHS}"),
        (lambda s: s.read_run("x" * 300), f"log = 'xxx.*; {PATHS}"),
        (lambda s: s.read_run("nowhere.mcap"), "log nowhere.mcap does not exist"),
        (lambda s: s.read_run("folder"), "log folder is a folder; give the path of a file"),
        (lambda s: s.read_run("junk.mcap"), "is not an MCAP file"),
        (lambda s: s.load_policy(5), f"policy = 5; {POLICIES}"),
        (lambda s: s.load_policy("wlak"), "policy 'wlak' does not exist .*built-in name: .*walk"),
        (lambda s: s.load_policy("folder"), "policy folder is a folder"),
        (lambda s: s.load_policy("junk.onnx"), "junk.onnx is no readable ONNX model"),
        (lambda s: s.load_policy("walk").act("x"), "policy walk expects 48 numbers"),
        (lambda s: s.load_policy("walk").act(5.0), "policy walk expects 48 numbers"),
        (lambda s: s.load_policy("walk").act(np.zeros(47)), "expects 48 numbers .*got 47"),
        (lambda s: s.load_policy("walk").setpoint_rad("x"), r"action of shape .*allowed: numbers of shape \(..., 12\)"),
        (lambda s: s.load_model(None), f"model = None; {MODELS}"),
        (lambda s: s.load_model("nothing"), "allowed: a YAML file, or one of ideal"),
        (lambda s: s.load_model("junk.yaml"), "junk.yaml is not valid YAML"),
        (lambda s: s.load_model("ideal", effects=5), "effects = 5; allowed: a list of effects"),
        (lambda s: s.load_model("ideal", effects=[5]), "effects = 5; allowed: mappings such as"),
        (lambda s: s.load_model("ideal", effects=[{"effect": "mud"}]), "mud"),
        (
            lambda s: s.load_model("ideal", effects=[_friction(level_nm=NAN)]),
            "level_nm is not a number",
        ),
        (lambda s: s.load_model("ideal", effects=[_friction(level_nm=-1)]), "level_nm = -1; allowed: 0 to 5"),
        (lambda s: s.load_model("ideal", effects=[_friction(level_nm="1")]), "level_nm = '1' is no number"),
        (lambda s: s.load_model("ideal", effects=[_friction(joints=["ankle"])]), "'ankle' is no joint"),
        (lambda s: s.load_model("ideal").with_effects("mud"), "effect 'mud' is no effect"),
        (lambda s: s.gaits(5), "run: 5 is no run; read a log first"),
        (lambda s: s.simulate("log.mcap", "ideal"), "run: 'log.mcap' is no run; read a log first"),
        (lambda s: s.compare(5), "runs = 5; allowed: a list of two runs or more"),
        (lambda s: s.compare([]), "needs two runs"),
        (lambda s: s.compare([1, 2]), r"runs\[0\]: 1 is no run"),
        (lambda s: s.diagnose([], "ideal", "out"), "logs is empty"),
        (lambda s: s.diagnose(5, "ideal", "out"), "logs = 5; allowed: one, or a list"),
        (lambda s: s.diagnose("nowhere", "ideal", "out"), "logs nowhere does not exist"),
        (lambda s: s.diagnose("folder", "ideal", "out"), "folder folder has no .mcap file"),
        (lambda s: s.diagnose(WALK, None, "out"), f"model = None; {MODELS}"),
        (lambda s: s.diagnose(WALK, "ideal", None), f"out = None; {PATHS}"),
        (lambda s: s.diagnose(WALK, "ideal", "text"), "out text: text is a file; give the path of a folder"),
        (lambda s: s.diagnose(WALK, "ideal", "text/below"), "out text/below: text is a file"),
        (lambda s: s.diagnose(WALK, "ideal", "out", policy=5), f"policy = 5; {POLICIES}"),
        (lambda s: s.diagnose(WALK, "ideal", "out", without=5), "without = 5; allowed: one, or a list"),
        (lambda s: s.diagnose(WALK, "ideal", "out", without="mud"), "mud"),
        (lambda s: s.diagnose(WALK, "ideal", "out", add_effects=[5]), "^add_effects 5; allowed: module:Class"),
        (lambda s: s.diagnose(WALK, "ideal", "out", add_effects="x:"), "^add_effects 'x:' cannot be loaded"),
        (lambda s: s.diagnose(WALK, "ideal", "out", seed="a"), "seed = 'a'; allowed: a whole number, 0 or more"),
        (lambda s: s.diagnose(WALK, "ideal", "out", seed=True), "seed = True; allowed: a whole number"),
        (lambda s: s.diagnose(WALK, "ideal", "out", device="gpu"), "device 'gpu' is unknown; allowed: cpu, cuda"),
        (lambda s: s.diagnose(WALK, "ideal", "out", device="cuda:x"), "device 'cuda:x'"),
        (lambda s: s.diagnose(WALK, "ideal", "out", device=0), "device = 0; allowed: cpu, cuda or cuda:N"),
        (lambda s: s.diagnose(WALK, "ideal", "out", progress=1), "progress = 1; allowed: True or False"),
        (lambda s: s.identify("nowhere", "walk", "out"), "logs nowhere does not exist"),
        (lambda s: s.identify("folder", "walk", "out"), "folder folder has no .mcap file"),
        (lambda s: s.identify("junk.mcap", "walk", "out"), "junk.mcap"),
        (lambda s: s.identify(WALK, "walk", "text"), "out text: text is a file"),
        (lambda s: s.identify(WALK, "walk", "out", generations=0), "generations = 0; allowed: a whole number, 1"),
        (lambda s: s.identify(WALK, "walk", "out", workers=0), "workers = 0; allowed: a whole number, 1 to 1024"),
        (lambda s: s.identify(WALK, "walk", "out", workers=2.0), "workers = 2.0; allowed: a whole number"),
        (lambda s: s.identify(WALK, "walk", "out", resume="no"), "resume = 'no'; allowed: True or False"),
        (lambda s: s.identify(WALK, "walk", "out", config={"serch": {}}), "serch"),
        (lambda s: s.identify(WALK, "walk", "out", config="junk.yaml"), "junk.yaml is not valid YAML"),
        (lambda s: s.train({"name": "x"}, "out"), "iterations"),
        (lambda s: s.train("nowhere.yaml", "out"), "config 'nowhere.yaml' does not exist"),
        (lambda s: s.train(5, "out"), f"config = 5; {PATHS}"),
        (lambda s: s.train(TINY, "text"), "out text: text is a file"),
        (lambda s: s.train(TINY, "."), "run folder . is not empty; choose another with out"),
        (lambda s: s.train(TINY, "out", changes=5), "changes = 5; allowed: a mapping"),
        (lambda s: s.train(TINY, "out", changes={"n_envs": -1}), "n_envs = -1"),
        (lambda s: s.train(TINY, "out", changes={"ppo.learning_rate": NAN}), "learning_rate"),
        (lambda s: s.train({**TINY, "model": "nothing"}, "out"), "model 'nothing' is not a file"),
        (lambda s: s.train({**TINY, "start_from": "nowhere"}, "out"), "'nowhere' does not exist"),
        (lambda s: s.train(TINY, "out", device="tpu"), "device 'tpu' is unknown"),
        (lambda s: s.export("nowhere", "out.onnx"), "run nowhere does not exist"),
        (lambda s: s.export("folder", "out.onnx"), "run folder has no checkpoint"),
        (lambda s: s.export(WALK, "text"), "text exists; nothing is overwritten"),
        (lambda s: s.export(WALK, "folder"), "out folder is a folder"),
        (lambda s: s.export(WALK, "out.onnx", name=""), "name = ''; allowed: a text"),
        (lambda s: s.export(WALK, "out.onnx", env=5), "env = 5; allowed: None"),
        (lambda s: s.export(NETWORK, "out.onnx", env=5), "env = 5; allowed: the environment that"),
        (lambda s: s.evaluate("walk", n=0), "n = 0; allowed: a whole number, 1 or more"),
        (lambda s: s.evaluate("walk", n=2.5), "n = 2.5; allowed: a whole number"),
        (lambda s: s.evaluate("walk", seed=-1), "seed = -1; allowed: a whole number, 0 or more"),
        (lambda s: s.evaluate("walk", model=5), f"model = 5; {MODELS}"),
        (lambda s: s.make_env(changes={"rewards.gate": 1.0}), "did you mean 'gait'"),
        (lambda s: s.make_env(raw_actions=1), "raw_actions = 1; allowed: True or False"),
        (lambda s: s.make_env(render_mode="human"), "render_mode = 'human'; allowed: None or 'rgb_array'"),
        (lambda s: s.make_env().step(np.zeros(12)), r"call reset\(\) first"),
        (lambda s: s.make_env().reset(seed=-1), "seed = -1; allowed: a whole number, 0 to 4294967295"),
        (lambda s: s.make_env().reset(options=5), "options = 5; allowed: a mapping"),
        (lambda s: s.make_env().reset(options={"comand": (0, 0, 0)}), "'comand' is unknown; allowed: command"),
        (lambda s: s.make_env().reset(options={"command": (0, 0)}), "allowed: three numbers"),
        (lambda s: s.make_env().reset(options={"command": (0, NAN, 0)}), "allowed: three numbers"),
        (lambda s: _stepped(s.make_env(), np.zeros(11)), r"shape \(11,\); allowed: finite numbers of shape \(12,\)"),
        (lambda s: _stepped(s.make_env(), np.full(12, NAN)), "allowed: finite numbers"),
        (lambda s: _stepped(s.make_env(), "walk"), "allowed: finite numbers"),
        (lambda s: s.make_vec_env(0), "num_envs = 0; allowed: a whole number, 1 to 65536"),
        (lambda s: s.make_vec_env("8"), "num_envs = '8'; allowed: a whole number"),
        (lambda s: _stepped(s.make_vec_env(2), np.zeros(12)), r"allowed: finite numbers of shape \(2, 12\)"),
        (lambda s: s.FakeSpot(5), f"scenario = 5; {PATHS}"),
        (lambda s: s.FakeSpot("nowhere"), "nowhere"),
        (lambda s: s.FakeSpot({"payloadd": {}}), "payloadd"),
        (lambda s: s.FakeSpot({"payloadd": {}}, model="ideal"), "payloadd"),
        (lambda s: s.FakeSpot(model="nothing"), "allowed: a YAML file, or one of ideal"),
        (lambda s: s.FakeSpot(lock_step="yes"), "lock_step = 'yes'; allowed: True or False"),
        (lambda s: s.FakeSpot().walk("walk"), "use it in a block"),
    ],
)
def test_what_is_wrong_is_said(call: Callable[[Any], Any], told: str, folder: Path) -> None:
    refuses(lambda: call(spot_rl), told, folder)


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (spot_rl.compare, "runs = .*; allowed: a list of two runs"),
        (lambda r: spot_rl.compare([r]), "needs two runs"),
        (lambda r: spot_rl.compare([r, 1]), r"runs\[1\]: 1 is no run"),
        (lambda r: spot_rl.compare([r, r], "text"), "out text: text is a file"),
        (lambda r: spot_rl.compare([r, r], names="ab"), "names = 'ab'; allowed: a list of 2 different texts"),
        (lambda r: spot_rl.compare([r, r], names=["a", "a"]), "allowed: a list of 2 different texts"),
        (lambda r: spot_rl.compare([r, r], names=["a", 5]), "names = 5; allowed: a text"),
        (lambda r: spot_rl.simulate(r, 5), f"model = 5; {MODELS}"),
        (lambda r: spot_rl.simulate(r, "ideal", policy="junk.onnx"), "no readable ONNX model"),
        (lambda r: spot_rl.simulate(r, "ideal", policy="walk", seed=0.5), "seed = 0.5; allowed: a whole number"),
        (lambda r: spot_rl.simulate(r, "ideal", policy="walk", noise=0), "noise = 0; allowed: True or False"),
        (lambda r: r.to_pandas("joints"), "topic 'joints' is not in a log; allowed: state"),
        (lambda r: r.to_pandas(["state"]), "is not in a log; allowed: state"),
    ],
)
def test_what_is_wrong_with_runs_is_said(call: Callable[[Run], Any], told: str, run: Run, folder: Path) -> None:
    refuses(lambda: call(run), told, folder)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"policy": 5}, f"policy = 5; {POLICIES}"),
        ({"policy": "junk.onnx"}, "junk.onnx"),
        ({"velocity": (1.0, 0.0)}, "velocity = .*allowed: three numbers within ±10"),
        ({"velocity": (NAN, 0.0, 0.0)}, "velocity = .*allowed: three numbers"),
        ({"velocity": (50.0, 0.0, 0.0)}, "velocity = .*allowed: three numbers"),
        ({"velocity": "100"}, "velocity = '100'; allowed: three numbers"),
        ({"velocity": 1.0}, "velocity = 1.0; allowed: three numbers"),
        ({"velocity": (0, 0, 0), "sequence": "forward"}, "velocity and sequence are both given"),
        ({"sequence": "nothing"}, "nothing"),
        ({"sequence": 5}, f"sequence = 5; {PATHS}"),
        ({"duration_s": "5"}, "duration_s = '5'; allowed: more than 0 and up to 3600 s"),
        ({"duration_s": NAN}, "duration_s = nan; allowed: more than 0"),
        ({"duration_s": 0}, "duration_s = 0; allowed: more than 0"),
        ({"log_dir": "text"}, "log_dir text: text is a file"),
        ({"labels": ["floor"]}, r"labels = \['floor'\]; allowed: a mapping of texts"),
        ({"labels": {"a=b": "c"}}, "labels = .*allowed: a mapping of texts"),
    ],
)
def test_what_is_wrong_with_a_walk_is_said(
    given: dict[str, Any], told: str, robot: spot_rl.FakeSpot, folder: Path
) -> None:
    refuses(lambda: robot.walk(**{"policy": "walk", "duration_s": 1.0, **given}), told, folder)


def _friction(**given: Any) -> dict[str, Any]:
    return {"effect": "coulomb_friction", "joints": ["knees"], "level_nm": 1.0, **given}


def _stepped(env: Any, action: Any) -> Any:
    env.reset(seed=0)
    return env.step(action)
