"""Policies of Isaac Lab, mjlab and the vendor's example: each quantity arrives where its own framework would put it.

The foreign side is written anew here, from names and in loops, so that it shares nothing with the maps under test.
"""

from __future__ import annotations

import contextlib
import copy
import functools
import json
import operator
import shutil
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import onnx
import onnxruntime
import pytest
import typer
import yaml
from onnx import TensorProto, helper, numpy_helper
from typer.testing import CliRunner

from spot_log.format.events import EventName
from spot_model.errors import BadInputError
from spot_model.plant.closed_loop import ClosedLoop
from spot_model.plant.plant import Plant
from spot_model.policy.contract import PolicyError
from spot_model.policy.policy import Policy, load_policy
from spot_model.robot import facts
from spot_model.robot.rotation import rotate_inverse_wxyz
from spot_model.robot.state import RobotState
from spot_runtime.admission import gait_event
from trainer.evaluate.export_command import export
from trainer.foreign import isaac_lab, mjlab, spot_rl_example
from trainer.foreign.description import checked
from trainer.foreign.import_command import import_policy
from trainer.simulate import stated_gait

WALK = Path(__file__).parents[2] / "policies" / "walk.onnx"
ISAAC = [f"{leg}_{joint}" for joint in ("hx", "hy", "kn") for leg in ("fl", "fr", "hl", "hr")]
POSE = {"[fh]l_hx": 0.1, "[fh]r_hx": -0.1, "f[lr]_hy": 0.9, "h[lr]_hy": 1.1, ".*_kn": -1.5}
STANDARD = (
    "base_lin_vel",
    "base_ang_vel",
    "projected_gravity",
    "velocity_commands",
    "joint_pos",
    "joint_vel",
    "actions",
)
FUNCTIONS = {
    "velocity_commands": "generated_commands",
    "joint_pos": "joint_pos_rel",
    "joint_vel": "joint_vel_rel",
    "actions": "last_action",
}

app = typer.Typer()
app.command("import")(import_policy)
app.command("export")(export)


def network(path: Path, width: int, *, seed: int = 3, extra_input: str = "") -> Path:
    """A small random network: obs (1, width) to actions (1, 12)."""
    rng = np.random.default_rng(seed)
    hidden, out = rng.normal(size=(width, 16)) / 8, rng.normal(size=(16, 12))
    nodes = [
        helper.make_node("MatMul", ["obs", "w0"], ["h"]),
        helper.make_node("Elu", ["h"], ["e"]),
        helper.make_node("MatMul", ["e", "w1"], ["actions"]),
    ]
    inputs = [helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, width])]
    if extra_input:
        inputs.append(helper.make_tensor_value_info(extra_input, TensorProto.FLOAT, [1, 8]))
    weights = [numpy_helper.from_array(w.astype(np.float32), name) for w, name in ((hidden, "w0"), (out, "w1"))]
    graph = helper.make_graph(
        nodes, "theirs", inputs, [helper.make_tensor_value_info("actions", TensorProto.FLOAT, [1, 12])], weights
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 8
    onnx.save(model, path)
    return path


def environment(**terms: dict[str, Any]) -> dict[str, Any]:
    """An Isaac Lab environment of Spot; keywords change or add observation terms, None removes one."""
    policy: dict[str, Any] = {"concatenate_terms": True, "enable_corruption": True, "history_length": None}
    for name in STANDARD:
        policy[name] = {"func": f"isaaclab.envs.mdp.observations:{FUNCTIONS.get(name, name)}", "params": {}}
    for name, change in terms.items():
        policy[name] = None if change is None else {**(policy.get(name) or {}), **change}
    return {
        "sim": {"dt": 0.002},
        "decimation": 10,
        "scene": {
            "robot": {
                "init_state": {"pos": [0, 0, 0.5], "joint_pos": POSE},
                "actuators": {
                    "spot_hip": {"joint_names_expr": [".*_h[xy]"], "stiffness": 60.0, "damping": 1.5},
                    "spot_knee": {"joint_names_expr": [".*_kn"], "stiffness": {".*": 55.0}, "damping": 1.25},
                },
            }
        },
        "observations": {"policy": policy},
        "actions": {"joint_pos": {"joint_names": [".*"], "scale": 0.2, "use_default_offset": True}},
        "commands": {
            "base_velocity": {"ranges": {"lin_vel_x": [-2.0, 3.0], "lin_vel_y": [-1.5, 1.5], "ang_vel_z": [-2.0, 2.0]}}
        },
    }


class TheirRobot:
    """What a foreign framework would feed its network, by name and joint by joint; keeps its own memory."""

    clip = np.inf
    """Of the actions, by the learner's wrapper."""

    def __init__(self, path: Path, terms: list[dict[str, Any]], joints: list[str], pose: dict[str, float]) -> None:
        self.session = onnxruntime.InferenceSession(path.read_bytes(), providers=["CPUExecutionProvider"])
        self.terms, self.joints, self.pose = terms, joints, pose
        self.last = dict.fromkeys(joints, 0.0)
        self.past: list[deque[list[float]]] = [deque(maxlen=term.get("history") or 1) for term in terms]

    def act(self, state: RobotState, command: Any) -> dict[str, float]:
        measured = dict(zip(facts.JOINT_NAMES, zip(state.position_rad, state.velocity_rad_s, strict=True), strict=True))
        attitude = state.odom_from_body_wxyz
        seen: list[float] = []
        for term, past in zip(self.terms, self.past, strict=True):
            joints = term.get("joints") or self.joints
            values = {
                "base_lin_vel": lambda: rotate_inverse_wxyz(attitude, state.linear_vel_of_body_in_odom_m_s),
                "base_ang_vel": lambda: rotate_inverse_wxyz(attitude, state.angular_vel_of_body_in_odom_rad_s),
                "projected_gravity": lambda: rotate_inverse_wxyz(attitude, np.array([0.0, 0.0, -1.0])),
                "command": lambda: command,
                "joint_pos": lambda j=joints: [measured[n][0] - self.pose[n] for n in j],
                "joint_pos_abs": lambda j=joints: [measured[n][0] for n in j],
                "joint_vel": lambda j=joints: [measured[n][1] for n in j],
                "actions": lambda: [self.last[n] for n in self.joints],
            }[term["of"]]()
            low, high = term.get("clip", (-np.inf, np.inf))
            row = list(np.clip(np.asarray(values, dtype=float), low, high) * np.asarray(term.get("scale", 1.0)))
            while len(past) < (past.maxlen or 1) - 1:
                past.append(row)
            past.append(row)
            seen += [value for old in past for value in old]
        (action,) = self.session.run(["actions"], {"obs": np.array([seen], dtype=np.float32)})
        self.last = dict(zip(self.joints, np.clip(action[0], -self.clip, self.clip).tolist(), strict=True))
        return dict(self.last)


def random_state(rng: np.random.Generator) -> RobotState:
    attitude = rng.normal(size=4)
    return RobotState(
        facts.DEFAULT_POSITION_RAD + rng.normal(size=12) / 4,
        rng.normal(size=12),
        np.zeros(12),
        np.zeros(3),
        attitude / np.linalg.norm(attitude),
        rng.normal(size=3),
        rng.normal(size=3),
        np.ones(4, dtype=np.bool_),
        0,
        0,
        0,
        0,
    )


def assert_same_setpoints(policy: Policy, theirs: TheirRobot, scale: dict[str, float], ticks: int = 6) -> None:
    """Several ticks of a random robot: the set-points of both sides are the same, joint by joint."""
    rng = np.random.default_rng(1)
    last, window = np.zeros(12, dtype=np.float32), None
    for _ in range(ticks):
        state, command = random_state(rng), rng.normal(size=3)
        window = policy.window(policy.observe(state, command, last).astype(np.float32), window)
        last = policy.act(window)
        asked = theirs.act(state, command)
        expected = [theirs.pose[name] + scale[name] * asked[name] for name in facts.JOINT_NAMES]
        np.testing.assert_allclose(policy.setpoint_rad(last), expected, atol=2e-5)


def pose_of(joints: list[str]) -> dict[str, float]:
    import re

    return {name: next(v for e, v in POSE.items() if re.fullmatch(e, name)) for name in joints}


def invoke(*words: str, code: int = 0) -> Any:
    told = CliRunner().invoke(app, list(words))
    assert told.exit_code == code, (told.output, told.exception)
    return told


def imported(path: Path, *words: str, like: str = "isaac-lab") -> Policy:
    """The policy that ``spot-rl policy import`` makes of a file, under the default name or the last word's."""
    invoke("import", str(path), "--like", like, "--yes", *words)
    return load_policy(path.with_suffix(".spot.onnx"))


def refused(path: Path, *words: str, like: str = "isaac-lab") -> str:
    """Why it refuses, in words, and that it writes nothing."""
    before = sorted(path.parent.iterdir())
    told = invoke("import", str(path), "--like", like, "--yes", *words, code=1)
    assert isinstance(told.exception, BadInputError)
    assert sorted(path.parent.iterdir()) == before
    return str(told.exception)


MEASURED: Final = stated_gait.stated_gaits


@pytest.fixture(autouse=True)
def _unmeasured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two seconds of simulation an import, spared where a test is not about them."""
    monkeypatch.setattr(stated_gait, "stated_gaits", lambda *_: ())


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., Path]:
    """Lay out a training run as Isaac Lab leaves it; returns the exported policy."""

    def lay(env: dict[str, Any], width: int = 48, **keywords: Any) -> Path:
        (tmp_path / "params").mkdir()
        (tmp_path / "exported").mkdir()
        text = yaml.dump(env, sort_keys=False)
        # As Isaac Lab writes it: tuples bear Python's tag.
        text = text.replace("lin_vel_x:\n", "lin_vel_x: !!python/tuple\n")
        (tmp_path / "params" / "env.yaml").write_text(text)
        return network(tmp_path / "exported" / "policy.onnx", width, **keywords)

    return lay


TERMS = [{"of": name.replace("velocity_commands", "command")} for name in STANDARD]


def test_isaac_lab_as_it_trains_spot(run: Callable[..., Path]) -> None:
    path = run(environment())
    told = invoke("import", str(path), "--like", "isaac-lab", "--yes")
    assert "breadth first" in told.output
    made = load_policy(path.with_name("policy.spot.onnx"))
    contract = made.contract
    assert contract.joint_names == tuple(ISAAC)
    assert contract.rate_hz == pytest.approx(50.0)
    assert (contract.velocity_command_low[0], contract.velocity_command_high[0]) == (-2.0, 3.0)
    knee = contract.joint_names.index("hl_kn")
    assert (contract.kp_nm_per_rad[knee], contract.kd_nm_s_per_rad[knee]) == (55.0, 1.25)
    assert_same_setpoints(made, TheirRobot(path, TERMS, ISAAC, pose_of(ISAAC)), dict.fromkeys(ISAAC, 0.2))


def test_another_layout_scales_clips_and_a_history(run: Callable[..., Path]) -> None:
    terms = {
        "base_lin_vel": None,
        "base_ang_vel": {"scale": 0.25},
        "joint_vel": {"scale": 0.05, "clip": [-2.0, 2.0], "history_length": 3},
        "joint_pos": {"func": "isaaclab.envs.mdp.observations:joint_pos", "history_length": 3},
        "actions": {"history_length": 2},
    }
    path = run(environment(**terms), width=3 + 3 + 3 + 36 + 36 + 24)
    made = imported(path)
    assert made.contract.observation_history == 3
    theirs = [
        {"of": "base_ang_vel", "scale": 0.25},
        {"of": "projected_gravity"},
        {"of": "command"},
        {"of": "joint_pos_abs", "history": 3},
        {"of": "joint_vel", "scale": 0.05, "clip": (-2.0, 2.0), "history": 3},
        {"of": "actions", "history": 2},
    ]
    assert_same_setpoints(made, TheirRobot(path, theirs, ISAAC, pose_of(ISAAC)), dict.fromkeys(ISAAC, 0.2))
    with pytest.raises(PolicyError, match="expects 144 numbers"):
        made.act(np.zeros(48))
    plant = Plant((), n_sims=2)
    seen: list[Any] = []
    for tick in ClosedLoop(plant, made).run(lambda _: np.array([0.5, 0.0, 0.0]), [(10,)] * 5):
        seen.append(tick.observation)
        last_three = [seen[max(0, tick.index - age)] for age in range(3)]
        np.testing.assert_allclose(tick.action, made.act(np.concatenate(last_three, axis=-1)), atol=1e-6)


def test_the_learners_file_names_groups_and_clips_actions(run: Callable[..., Path]) -> None:
    env = environment(base_lin_vel=None)
    env["observations"]["estimated"] = {"base_lin_vel": {"func": "isaaclab.envs.mdp.observations:base_lin_vel"}}
    path = run(env)
    agent = {"clip_actions": 0.5, "obs_groups": {"actor": ["policy", "estimated"], "critic": ["policy"]}}
    (path.parent.parent / "params" / "agent.yaml").write_text(yaml.dump(agent))
    assert "clipped to ±0.5" in invoke("import", str(path), "--like", "isaac-lab", "--yes").output
    theirs = TheirRobot(path, [*TERMS[1:], TERMS[0]], ISAAC, pose_of(ISAAC))
    theirs.clip = 0.5
    made = load_policy(path.with_name("policy.spot.onnx"))
    assert_same_setpoints(made, theirs, dict.fromkeys(ISAAC, 0.2))
    assert max(abs(value) for value in theirs.last.values()) == 0.5


@pytest.mark.parametrize(
    ("agent", "told"),
    [
        ({"clip_actions": -1.0}, "clip_actions = -1.0: Input should be greater than 0"),
        ({"obs_groups": {"actor": "policy"}}, "obs_groups.actor = 'policy': Input should be a valid list"),
        ({"obs_groups": {"actor": ["policy", "camera"]}}, "no observations.camera"),
    ],
)
def test_a_learners_file_that_cannot_be_is_refused(run: Callable[..., Path], agent: dict[str, Any], told: str) -> None:
    path = run(environment())
    (path.parent.parent / "params" / "agent.yaml").write_text(yaml.dump(agent))
    assert told in refused(path)


def test_weights_in_a_file_beside_the_policy_are_taken_in(run: Callable[..., Path]) -> None:
    """As PyTorch's exporter writes them by default, and with it those of rsl-rl and Isaac Lab."""
    path = run(environment())
    theirs = TheirRobot(path, TERMS, ISAAC, pose_of(ISAAC))
    onnx.save(onnx.load(path), path, save_as_external_data=True, location="policy.onnx.data", size_threshold=0)
    assert_same_setpoints(imported(path), theirs, dict.fromkeys(ISAAC, 0.2))
    path.with_name("policy.onnx.data").unlink()
    told = refused(path, "--out", str(path.with_name("b.onnx")))
    assert "is not whole" in told
    assert "with the .data file beside it" in told


def test_joints_in_any_order_with_a_scale_each(run: Callable[..., Path]) -> None:
    rng = np.random.default_rng(7)
    robot_order, action_order = ([str(n) for n in rng.permutation(facts.JOINT_NAMES)] for _ in range(2))
    env = environment()
    scale = {"hx": 0.1, "hy": 0.3, "kn": 0.25}
    env["actions"]["joint_pos"] |= {
        "joint_names": action_order,
        "preserve_order": True,
        "scale": {f".*_{end}": v for end, v in scale.items()},
    }
    path = run(env)
    made = imported(path, "--joint-order", ",".join(robot_order))
    assert made.contract.joint_names == tuple(action_order)
    terms = [t if t["of"] not in {"joint_pos", "joint_vel"} else {**t, "joints": robot_order} for t in TERMS]
    theirs = TheirRobot(path, terms, action_order, pose_of(action_order))
    assert_same_setpoints(made, theirs, {name: scale[name[-2:]] for name in facts.JOINT_NAMES})


def mjlab_metadata(joints: list[str], **changes: str | None) -> dict[str, str]:
    pose = pose_of(joints)
    metadata: dict[str, str | None] = {
        "run_path": "run",
        "joint_names": ",".join(joints),
        "joint_stiffness": ",".join(["60.000"] * 12),
        "joint_damping": ",".join(["1.500"] * 12),
        "default_joint_pos": ",".join(f"{pose[name]:.3f}" for name in joints),
        "command_names": "twist",
        "observation_names": "base_lin_vel,base_ang_vel,projected_gravity,joint_pos,joint_vel,actions,command",
        "action_scale": ",".join(["0.250"] * 12),
        **changes,
    }
    return {key: value for key, value in metadata.items() if value is not None}


def with_metadata(path: Path, metadata: dict[str, str]) -> Path:
    model = onnx.load(path)
    helper.set_model_props(model, metadata)
    onnx.save(model, path)
    return path


def test_mjlab_before_and_since_it_names_histories(tmp_path: Path) -> None:
    joints = list(facts.JOINT_NAMES)
    terms = [{"of": name} for name in ("base_lin_vel", "base_ang_vel", "projected_gravity", "joint_pos", "joint_vel")]
    terms += [{"of": "actions"}, {"of": "command"}]
    old = with_metadata(network(tmp_path / "old.onnx", 48), mjlab_metadata(joints))
    made = imported(old, "--rate-hz", "40", "--commands=-1,-1,-1:2,1,1", like="mjlab")
    assert made.contract.rate_hz == 40.0
    assert made.contract.velocity_command_high == (2.0, 1.0, 1.0)
    assert_same_setpoints(made, TheirRobot(old, terms, joints, pose_of(joints)), dict.fromkeys(joints, 0.25))
    new = with_metadata(
        network(tmp_path / "new.onnx", 48 + 12 + 3),
        mjlab_metadata(
            joints,
            observation_terms_scale="1.000,0.250;0.500;1.000,1.000,1.000,1.000,1.000,2.000",
            observation_terms_clip=",".join(["-inf;inf"] * 3 + ["-0.100;0.100"] + ["-inf;inf"] * 3),
            observation_terms_history_length="0,2,0,0,2,0,0",
            observation_terms_flatten_history_dim=",".join(["True"] * 7),
        ),
    )
    terms[1] |= {"scale": [0.25, 0.5, 1.0], "history": 2}
    terms[3] |= {"clip": (-0.1, 0.1)}
    terms[4] |= {"history": 2}
    terms[6] |= {"scale": 2.0}
    made = imported(new, like="mjlab")
    assert_same_setpoints(made, TheirRobot(new, terms, joints, pose_of(joints)), dict.fromkeys(joints, 0.25))


def as_mjlab_writes(values: list[Any]) -> str:
    """A list as the ``list_to_csv_str`` of mjlab 1.6.0 writes it: numbers and flags with three decimals."""

    def entry(value: Any) -> str:
        if isinstance(value, (list, tuple)):
            return ";".join(map(entry, value))
        return f"{value:.3f}" if isinstance(value, (int, float)) else str(value)

    return ",".join(map(entry, values))


def mjlab_160(history: float = 0, flattened: bool = True) -> dict[str, str]:
    """The metadata of a policy that mjlab 1.6.0 exported, of all keys that it writes."""
    n, joints = 7, list(facts.JOINT_NAMES)
    return mjlab_metadata(
        joints,
        command_names=as_mjlab_writes(["twist"]),
        observation_terms_scale=as_mjlab_writes([1.0, [2.0, 2.0, 0.25], *[1.0] * (n - 2)]),
        observation_terms_flatten_history_dim=as_mjlab_writes([flattened] * n),
        observation_terms_history_length=as_mjlab_writes([history] * n),
        observation_terms_clip=as_mjlab_writes([[-np.inf, np.inf]] * n),
        action_scale="0.25",
    )


@pytest.mark.parametrize("history", [0, 1, 3])
def test_metadata_as_mjlab_1_6_0_itself_writes_them(tmp_path: Path, history: int) -> None:
    assert mjlab_160(3)["observation_terms_history_length"].startswith("3.000,")
    assert mjlab_160(3)["observation_terms_flatten_history_dim"].startswith("1.000,")
    path = with_metadata(network(tmp_path / "p.onnx", 48 * max(1, history)), mjlab_160(history))
    names = ("base_lin_vel", "base_ang_vel", "projected_gravity", "joint_pos", "joint_vel", "actions", "command")
    terms: list[dict[str, Any]] = [{"of": name, "history": history} for name in names]
    terms[1]["scale"] = [2.0, 2.0, 0.25]
    joints = list(facts.JOINT_NAMES)
    made = imported(path, like="mjlab")
    assert_same_setpoints(made, TheirRobot(path, terms, joints, pose_of(joints)), dict.fromkeys(joints, 0.25))


def test_a_history_of_mjlab_that_is_none_is_refused(tmp_path: Path) -> None:
    path = network(tmp_path / "p.onnx", 48 * 2)
    for history in (-1, 2.5, 51, np.inf):
        assert "at most 50, a whole number" in refused(with_metadata(path, mjlab_160(history)), like="mjlab")
    assert "gets its ticks as rows" in refused(with_metadata(path, mjlab_160(2, flattened=False)), like="mjlab")


class TheirStack:
    """A robot whose framework keeps whole frames, as legged_gym's descendants do."""

    def __init__(self, path: Path, history: int, is_newest_first: bool) -> None:
        self.robot = TheirRobot(path, TERMS, ISAAC, pose_of(ISAAC))
        self.pose, self.session = self.robot.pose, self.robot.session
        self.robot.session = self  # the frame that would go to the network comes here
        self.frames: deque[Any] = deque(maxlen=history)
        self.is_newest_first = is_newest_first

    def run(self, names: list[str], fed: dict[str, Any]) -> Any:
        frame = fed["obs"][0]
        while len(self.frames) < (self.frames.maxlen or 1) - 1:
            self.frames.append(frame)
        self.frames.append(frame)
        seen = reversed(self.frames) if self.is_newest_first else self.frames
        return self.session.run(names, {"obs": np.concatenate(list(seen))[None]})

    def act(self, state: RobotState, command: Any) -> dict[str, float]:
        return self.robot.act(state, command)


@pytest.mark.parametrize("is_newest_first", [False, True])
def test_a_history_of_whole_frames(run: Callable[..., Path], is_newest_first: bool) -> None:
    env = environment()
    env["observations"]["policy"] |= {
        "history_length": 3,
        "history_layout": "frames",
        "history_newest_first": is_newest_first,
    }
    path = run(env, width=48 * 3)
    told = invoke("import", str(path), "--like", "isaac-lab", "--yes").output
    assert "ticks before the newest: 1" in told
    assert "assumed: the history" not in told
    made = load_policy(path.with_suffix(".spot.onnx"))
    assert_same_setpoints(made, TheirStack(path, 3, is_newest_first), dict.fromkeys(ISAAC, 0.2))


def test_terms_with_the_newest_tick_first(run: Callable[..., Path]) -> None:
    env = environment(base_lin_vel=None, joint_vel={"history_length": 2})
    env["observations"]["policy"] |= {"history_layout": "terms", "history_newest_first": True}
    path = run(env, width=45 + 12)
    terms = isaac_lab.policy_of_isaac_lab(env, "p").terms
    assert [term.ages for term in terms] == [(0,), (0,), (0,), (0,), (0, 1), (0,)]
    assert imported(path).contract.observation_history == 2


def test_a_history_that_was_written_by_hand_is_told(run: Callable[..., Path]) -> None:
    env = environment()
    env["observations"]["policy"]["history_length"] = 3
    path = run(env, width=48 * 3)
    told = invoke("import", str(path), "--like", "isaac-lab", "--yes").output
    assert "assumed: the history as Isaac Lab stacks it" in told
    assert "'history_layout: frames' names" in told
    assert "the same, if the training did what is assumed above" in told
    described = isaac_lab.policy_of_isaac_lab(env | {}, "p")
    assert any("history" in what for what in described.assumed)
    env["observations"]["policy"]["flatten_history_dim"] = True  # as Isaac Lab dumps it
    assert not any("history" in what for what in isaac_lab.policy_of_isaac_lab(env, "p").assumed)
    env["observations"]["policy"]["flatten_history_dim"] = False
    with pytest.raises(BadInputError, match="gets its ticks as rows"):
        isaac_lab.policy_of_isaac_lab(env, "p")
    env["observations"]["policy"] |= {"history_length": None, "history_layout": "frames"}
    env["observations"]["policy"]["joint_vel"]["history_length"] = 2
    with pytest.raises(BadInputError, match="histories of several lengths"):
        isaac_lab.policy_of_isaac_lab(env, "p")


NORMALISED: Final = (
    {"empirical_normalization": True},
    {"empirical_normalization": None, "policy": {"actor_obs_normalization": True}},
    {"actor": {"obs_normalization": True}},
    {"params": {"config": {"normalize_input": True}}},
    {"agent": {"state_preprocessor": "RunningStandardScaler"}},
)


@pytest.mark.parametrize("agent", NORMALISED)
def test_a_normaliser_that_the_training_had_and_the_file_has_not_is_refused(
    run: Callable[..., Path], agent: dict[str, Any]
) -> None:
    path = run(environment())
    side_file = path.parent.parent / "params" / "agent.yaml"
    side_file.write_text(yaml.dump(agent))
    told = refused(path)
    assert "the observation was normalised" in told
    assert "export it together with the normaliser" in told
    plain = path.read_bytes()
    normalised(path, np.zeros(48))  # of a training that never used it
    assert "normalised" in refused(path)
    path.write_bytes(plain)
    normalised(path, np.linspace(-1.0, 1.0, 48))
    assert_same_setpoints(imported(path), TheirRobot(path, TERMS, ISAAC, pose_of(ISAAC)), dict.fromkeys(ISAAC, 0.2))


def normalised(path: Path, mean: Any) -> None:
    """Put (observation − mean) / (deviation + 0.01) before a network, as rsl-rl exports it."""
    model = onnx.load(path)
    for name, value in (("mean", mean), ("deviation", np.ones(48)), ("eps", np.array(0.01))):
        model.graph.initializer.append(numpy_helper.from_array(value.astype(np.float32), name))
    model.graph.node[0].input[0] = "scaled"
    for node in (
        helper.make_node("Div", ["centred", "divisor"], ["scaled"]),
        helper.make_node("Add", ["deviation", "eps"], ["divisor"]),
        helper.make_node("Sub", ["obs", "mean"], ["centred"]),
    ):
        model.graph.node.insert(0, node)
    onnx.save(model, path)


def recurrent(path: Path, kind: str, layout: int) -> None:
    """A network of one recurrent operator, without its state as input, whichever axis is time."""
    gates, rng = {"LSTM": 4, "GRU": 3, "RNN": 1}[kind], np.random.default_rng(0)
    weights = {"w": (1, gates * 12, 48), "r": (1, gates * 12, 12)}
    graph = helper.make_graph(
        [
            helper.make_node("Unsqueeze", ["obs", "axis"], ["x"]),
            helper.make_node(kind, ["x", "w", "r"], ["y"], hidden_size=12, layout=layout),
            helper.make_node("Reshape", ["y", "row"], ["actions"]),
        ],
        "theirs",
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, 48])],
        [helper.make_tensor_value_info("actions", TensorProto.FLOAT, [1, 12])],
        [
            *(numpy_helper.from_array(rng.normal(size=s).astype(np.float32), name) for name, s in weights.items()),
            numpy_helper.from_array(np.array([0], dtype=np.int64), "axis"),
            numpy_helper.from_array(np.array([1, 12], dtype=np.int64), "row"),
        ],
    )
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)


@pytest.mark.parametrize("kind", ["LSTM", "GRU", "RNN"])
@pytest.mark.parametrize("layout", [0, 1])
def test_a_recurrent_operator_without_its_state_is_refused_by_name(
    run: Callable[..., Path], kind: str, layout: int
) -> None:
    path = run(environment())
    recurrent(path, kind, layout)
    assert f"the network is recurrent (operator {kind})" in refused(path)


def test_limits_are_those_of_the_command_that_the_observation_names(run: Callable[..., Path]) -> None:
    env = environment(velocity_commands={"params": {"command_name": "gait"}})
    slow = {"lin_vel_x": [-0.3, 0.4], "lin_vel_y": [-0.2, 0.2], "ang_vel_z": [-0.5, 0.5]}
    env["commands"] |= {"gait": {"ranges": slow}}
    described = isaac_lab.policy_of_isaac_lab(env, "p")
    assert (described.command_low, described.command_high) == ((-0.3, -0.2, -0.5), (0.4, 0.2, 0.5))
    del env["observations"]["policy"]["velocity_commands"]["params"]["command_name"]
    with pytest.raises(BadInputError, match="commands base_velocity, gait, and its observation names none"):
        isaac_lab.policy_of_isaac_lab(env, "p")
    path = run(environment(velocity_commands={"params": {"command_name": "other"}}))
    assert "has commands base_velocity, and its observation names other; name one as" in refused(path)


def test_the_action_is_the_output_that_says_so(run: Callable[..., Path]) -> None:
    path = run(environment())
    alone = Path(shutil.copy(path, path.with_name("alone.onnx")))
    model = onnx.load(path)
    model.graph.node.append(helper.make_node("Neg", ["actions"], ["deviation"]))
    model.graph.output.insert(0, helper.make_tensor_value_info("deviation", TensorProto.FLOAT, [1, 12]))
    onnx.save(model, path)
    theirs = functools.partial(TheirRobot, alone, TERMS, ISAAC, pose_of(ISAAC))
    assert_same_setpoints(imported(path), theirs(), dict.fromkeys(ISAAC, 0.2))
    path.with_suffix(".spot.onnx").unlink()
    model.graph.node[-2].output[0] = model.graph.node[-1].input[0] = model.graph.output[1].name = "mean"
    onnx.save(model, path)
    told = "outputs: deviation of 12 numbers, mean of 12 numbers; export it with the one of 12 that is the action alone"
    assert told in refused(path)
    model.graph.output[0].CopyFrom(helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, 48]))
    onnx.save(model, path)
    assert_same_setpoints(imported(path), theirs(), dict.fromkeys(ISAAC, 0.2))


def test_an_import_states_the_gait_that_it_measures(run: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """A random network lets the robot fall: import and run say so before the motors get power."""
    monkeypatch.setattr(stated_gait, "stated_gaits", MEASURED)
    env = environment()
    env["commands"]["base_velocity"]["ranges"]["lin_vel_x"] = [-0.5, 0.5]
    path = run(env)
    told = invoke("import", str(path), "--like", "isaac-lab", "--yes", "--out", str(path.with_name("mine.onnx")))
    assert "warning: policy mine falls at 0.3, 0.5 m/s" in told.output
    event, sentence = gait_event(load_policy(path.with_name("mine.onnx")).contract)
    assert event is EventName.GAIT_DOUBTFUL
    assert sentence.startswith("policy mine falls at 0.3, 0.5 m/s; measured in simulation: fall at")


def test_an_imported_policy_is_measured_anew(run: Callable[..., Path], tmp_path: Path) -> None:
    ours = imported(run(environment()))
    invoke("export", str(ours.path), "--out", str(tmp_path / "again.onnx"), "--name", "again")
    again = load_policy(tmp_path / "again.onnx")
    assert again.contract == ours.contract.model_copy(update={"name": "again"})
    _assert_same_policy(ours, again)


def test_the_vendors_example_and_back(tmp_path: Path) -> None:
    folder = tmp_path / "theirs"
    told = invoke("export", str(WALK), "--for", "spot-rl-example", "--out", str(folder))
    assert "env_cfg.json" in told.output
    ours, back = load_policy(WALK), imported(folder / "policy.onnx", like="spot-rl-example")
    assert back.contract.joint_names == tuple(ISAAC)
    environment_file = json.loads((folder / "env_cfg.json").read_text())
    assert environment_file["actions"]["joint_pos"]["scale"] == ours.contract.action_scale_rad
    _assert_same_policy(ours, back)
    told = invoke("export", str(WALK), "--for", "spot-rl-example", "--out", str(folder), code=1)
    assert "a folder of one policy" in str(told.exception)


def test_mjlab_and_back(tmp_path: Path) -> None:
    path = tmp_path / "for_mjlab.onnx"
    invoke("export", str(WALK), "--for", "mjlab", "--out", str(path))
    metadata = {p.key: p.value for p in onnx.load(path).metadata_props}
    assert metadata["joint_names"].split(",") == list(load_policy(WALK).contract.joint_names)
    _assert_same_policy(load_policy(WALK), imported(path, like="mjlab"))


def _assert_same_policy(one: Policy, other: Policy) -> None:
    rng = np.random.default_rng(2)
    last = [np.zeros(12, dtype=np.float32)] * 2
    for _ in range(5):
        state, command = random_state(rng), rng.normal(size=3)
        last = [p.act(p.observe(state, command, memory)) for p, memory in zip((one, other), last, strict=True)]
        np.testing.assert_allclose(one.setpoint_rad(last[0]), other.setpoint_rad(last[1]), atol=2e-5)
    assert one.contract.velocity_command_high == other.contract.velocity_command_high or "mjlab" in str(other)


@pytest.mark.filterwarnings("ignore:.*torch.jit.*is deprecated:DeprecationWarning")
def test_torchscript(tmp_path: Path, run: Callable[..., Path]) -> None:
    import torch

    path = run(environment())
    torch.manual_seed(0)
    net = torch.nn.Sequential(torch.nn.Linear(48, 8), torch.nn.ELU(), torch.nn.Linear(8, 12))
    script = path.with_suffix(".pt")
    torch.jit.save(torch.jit.trace(net, torch.zeros(1, 48)), script)
    made = imported(script, "--name", "scripted")
    assert made.contract.name == "scripted"
    row = np.random.default_rng(0).normal(size=48).astype(np.float32)
    with torch.no_grad():
        np.testing.assert_allclose(made.act(row), net(torch.from_numpy(row)).numpy(), atol=1e-5)


@pytest.mark.filterwarnings("ignore:.*torch.jit.*is deprecated:DeprecationWarning")
def test_legged_gym_by_the_file_in_the_documentation(tmp_path: Path) -> None:
    """The observation as ``compute_observations`` of legged_gym puts it together, the action as ``step`` clips it."""
    import torch

    page = (Path(__file__).parents[2] / "docs" / "other-frameworks.md").read_text()
    (tmp_path / "env.yaml").write_text(page.partition("```yaml\n")[2].partition("```")[0])
    (tmp_path / "agent.yaml").write_text("clip_actions: 1.5\n")
    order = page.partition("--joint-order ")[2].split()[0]
    torch.manual_seed(1)
    actor = torch.nn.Sequential(torch.nn.Linear(48, 16), torch.nn.ELU(), torch.nn.Linear(16, 12))
    torch.jit.script(actor).save(str(tmp_path / "policy_1.pt"))
    made, rng = imported(tmp_path / "policy_1.pt", "--joint-order", order), np.random.default_rng(3)
    urdf = [f"{leg}_{joint}" for leg in ("fl", "fr", "hl", "hr") for joint in ("hx", "hy", "kn")]
    pose = np.array([0.1, 0.9, -1.5, -0.1, 0.9, -1.5, 0.1, 1.1, -1.5, -0.1, 1.1, -1.5])
    ours = [urdf.index(name) for name in facts.JOINT_NAMES]
    actions, last = np.zeros(12), np.zeros(12, dtype=np.float32)
    for _ in range(5):
        state, command = random_state(rng), rng.normal(size=3)
        attitude = state.odom_from_body_wxyz
        theirs = [facts.JOINT_NAMES.index(name) for name in urdf]
        seen = np.concatenate(
            [
                rotate_inverse_wxyz(attitude, state.linear_vel_of_body_in_odom_m_s) * 2.0,
                rotate_inverse_wxyz(attitude, state.angular_vel_of_body_in_odom_rad_s) * 0.25,
                rotate_inverse_wxyz(attitude, np.array([0.0, 0.0, -1.0])),
                command * [2.0, 2.0, 0.25],
                state.position_rad[theirs] - pose,
                state.velocity_rad_s[theirs] * 0.05,
                actions,
            ]
        )
        with torch.no_grad():
            actions = np.clip(actor(torch.from_numpy(seen.astype(np.float32))[None]).numpy()[0], -1.5, 1.5)
        last = made.act(made.observe(state, command, last))
        np.testing.assert_allclose(made.setpoint_rad(last), (0.25 * actions + pose)[ours], atol=2e-5)


@pytest.mark.filterwarnings("ignore:.*torch.jit.*is deprecated:DeprecationWarning")
def test_torchscript_with_a_memory_is_refused(run: Callable[..., Path]) -> None:
    """As Isaac Lab and legged_gym export recurrent networks: the state is a buffer, and no input shows it."""
    import torch

    class Recurrent(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.rnn = torch.nn.LSTM(48, 12)
            self.register_buffer("hidden_state", torch.zeros(1, 1, 12))
            self.register_buffer("cell_state", torch.zeros(1, 1, 12))

        def forward(self, x: torch.Tensor) -> torch.Tensor:
            out, (h, c) = self.rnn(x.unsqueeze(0), (self.hidden_state, self.cell_state))
            self.hidden_state[:] = h
            self.cell_state[:] = c
            return out.squeeze(0)

    path = run(environment()).with_suffix(".pt")
    torch.jit.save(torch.jit.script(Recurrent()), path)
    told = refused(path)
    assert "as where the network has a memory; only networks without memory are run" in told


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"height_scan": {"func": "isaaclab.envs.mdp.observations:height_scan"}}, "'height_scan' is nothing"),
        ({"joint_pos": {"modifiers": [{"func": "x"}]}}, "modifiers are not supported"),
        ({"joint_pos": {"params": {"asset_cfg": {"joint_names": [".*_h[xy]"]}}}}, "sees and moves fl_hx"),
        ({"joint_pos": {"history_length": 99}}, "less than or equal to 50"),
    ],
)
def test_what_cannot_be_is_refused_by_name(run: Callable[..., Path], change: dict[str, Any], told: str) -> None:
    path = run(environment(**change))
    assert told in refused(path)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"pose": {**POSE, ".*_hx": 1.5}}, "default_position_rad of fl_hx is 1.5; allowed: -0.785398 to 0.785398"),
        ({"pose": {**POSE, ".*_hy": 51.6}}, "of fl_hy is 51.6; allowed: -0.898845 to 2.29511 (radians, not degrees)"),
        ({"stiffness": 7500.0}, "kp_nm_per_rad of fl_kn is 7500; allowed: above 0"),
        ({"stiffness": 0.0}, "kp_nm_per_rad of fl_kn is 0; allowed: above 0 (at 0 the joint ignores its set-point)"),
        ({"stiffness": 5.0}, "the stiffness of fl_kn is 5 N·m/rad; allowed: at least 14.9"),
        ({"damping": -1.0}, "kd_nm_s_per_rad of fl_kn is -1; allowed: 0 to 50"),
        ({"dt": 0.0001}, "rate_hz = 1000.0: Input should be less than or equal to 333"),
        ({"scale": 0.0}, "action scale of fl_hx is 0; allowed: any number but 0"),
        ({"scale": 11.46}, "action_scale_rad = 11.46: Input should be less than or equal to 2"),
    ],
)
def test_numbers_that_no_robot_bears_are_refused_before_anybody_is_asked(
    run: Callable[..., Path], change: dict[str, Any], told: str
) -> None:
    env = environment()
    robot = env["scene"]["robot"]
    robot["init_state"]["joint_pos"] = change.get("pose", POSE)
    knee = robot["actuators"]["spot_knee"]
    knee |= {key: change[key] for key in ("stiffness", "damping") if key in change}
    env["sim"]["dt"] = change.get("dt", 0.002)
    env["actions"]["joint_pos"]["scale"] = change.get("scale", 0.2)
    path = run(env)
    assert told in refused(path)
    assert "Is this what" not in invoke("import", str(path), "--like", "isaac-lab", code=1).output


BAD: Final = (
    None,
    True,
    "x",
    "",
    -1,
    0,
    1e9,
    float("nan"),
    10**400,
    [],
    [None],
    ["("],
    [1, "y", {}],
    {},
    {"(": 1},
    {"a": []},
)


def places(data: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where a file's data have a value, however deep."""
    for key in data if isinstance(data, dict) else range(len(data)) if isinstance(data, list) else ():
        yield (*path, key)
        yield from places(data[key], (*path, key))


def test_whatever_stands_anywhere_in_a_side_file_is_taken_or_refused_in_words() -> None:
    """Every place of a full env.yaml with every bad value: no exception but ours."""
    params = {"asset_cfg": {"joint_names": list(facts.JOINT_NAMES), "preserve_order": True}}
    whole = environment(joint_pos={"params": params, "scale": [1.0], "clip": [-9.0, 9.0], "history_length": 2})
    agent = {"clip_actions": 100.0, "obs_groups": {"policy": ["policy"]}}
    n = n_refused = 0
    for path in [("agent", *place) for place in places(agent)] + [("env", *place) for place in places(whole)]:
        for bad in BAD:
            data = copy.deepcopy({"env": whole, "agent": agent})
            held = functools.reduce(operator.getitem, path[:-1], data)
            held[path[-1]] = bad  # type: ignore[index]
            n += 1
            try:
                checked(isaac_lab.policy_of_isaac_lab(data["env"], "p", agent=data["agent"]))
                checked(spot_rl_example.policy_of_example(data["env"], "p"))
            except BadInputError:
                n_refused += 1
    assert n > 1000
    assert n_refused > n // 3


def test_whatever_stands_in_metadata_is_taken_or_refused_in_words() -> None:
    of_terms = {"scale": "1.0", "clip": "-9;9", "history_length": "2"}
    more = {f"observation_terms_{key}": ",".join([value] * 7) for key, value in of_terms.items()}
    whole = mjlab_metadata(list(facts.JOINT_NAMES), **more)
    for key in whole:
        for bad in (
            "",
            "x",
            ",",
            "0",
            "-1",
            "nan",
            "inf",
            "1e400",
            "1;2;3",
            ",".join(["nan"] * 12),
            ",".join(["0"] * 12),
        ):
            with contextlib.suppress(BadInputError):
                checked(mjlab.policy_of_mjlab({**whole, key: bad}, "p"))
    checked(mjlab.policy_of_mjlab(whole, "p"))


def graph_without_output(path: Path) -> None:
    model = onnx.load(path)
    del model.graph.output[:]
    onnx.save(model, path)


def with_weights_of_nan(path: Path) -> None:
    model = onnx.load(path)
    model.graph.initializer[0].CopyFrom(numpy_helper.from_array(np.full((48, 16), np.nan, dtype=np.float32), "w0"))
    onnx.save(model, path)


def of_doubles(path: Path) -> None:
    model = onnx.load(path)
    model.graph.input[0].type.tensor_type.elem_type = TensorProto.DOUBLE
    onnx.save(model, path)


def of_three_axes(path: Path) -> None:
    model = onnx.load(path)
    model.graph.input[0].CopyFrom(helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, 5, 48]))
    onnx.save(model, path)


@pytest.mark.parametrize("spoil", [graph_without_output, with_weights_of_nan, of_doubles, of_three_axes])
def test_a_network_that_is_none_is_refused_in_words(run: Callable[..., Path], spoil: Callable[[Path], None]) -> None:
    path = run(environment())
    spoil(path)
    assert refused(path)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"class_type": "isaaclab.envs.mdp.actions.joint_actions:RelativeJointPositionAction"}, "is RelativeJoint"),
        ({"clip": {".*": [-1.0, 1.0]}}, "joint_pos.clip is not supported"),
        ({"use_default_offset": False}, "use_default_offset is false"),
    ],
)
def test_actions_that_mean_something_else_are_refused(
    run: Callable[..., Path], change: dict[str, Any], told: str
) -> None:
    env = environment()
    env["actions"]["joint_pos"] |= change
    assert told in refused(run(env))


def test_of_a_robot_with_an_arm_only_the_legs_may_be_meant(run: Callable[..., Path]) -> None:
    env = environment()
    env["scene"]["robot"]["init_state"]["joint_pos"] = {**POSE, "arm0_sh0": 0.0}
    env["actions"]["joint_pos"]["joint_names"] = [".*_h[xy]", ".*_kn"]
    path = run(env)
    told = refused(path)
    assert "observations.policy.joint_pos: joints fl_hx" in told
    assert "arm0_sh0" in told
    for term in ("joint_pos", "joint_vel"):
        env["observations"]["policy"][term]["params"] = {"asset_cfg": {"joint_names": [".*_h[xy]", ".*_kn"]}}
    (path.parent.parent / "params" / "env.yaml").write_text(yaml.dump(env))
    assert imported(path).contract.name == "policy"


def test_no_joint_order_is_assumed_where_the_file_tells_it(run: Callable[..., Path]) -> None:
    told = {"joint_names": list(facts.JOINT_NAMES), "preserve_order": True}
    env = environment(**{name: {"params": {"asset_cfg": told}} for name in ("joint_pos", "joint_vel")})
    path = run(env)
    assert "breadth first" in invoke("import", str(path), "--like", "isaac-lab", "--yes").output
    env["actions"]["joint_pos"] |= told
    (path.parent.parent / "params" / "env.yaml").write_text(yaml.dump(env))
    again = invoke("import", str(path), "--like", "isaac-lab", "--yes", "--out", str(path.with_name("again.onnx")))
    assert "breadth first" not in again.output


def test_networks_that_do_not_fit_are_refused(run: Callable[..., Path]) -> None:
    path = run(environment(), width=45)
    assert "sees 45 numbers" in refused(path)
    network(path, 48, extra_input="h_in")
    assert "inputs obs, h_in; allowed: one" in refused(path)


def test_a_missing_side_file_or_key_is_named(tmp_path: Path) -> None:
    path = network(tmp_path / "p.onnx", 48)
    assert "--env" in refused(path)
    assert "one beside" in refused(path, like="spot-rl-example")
    assert "joint_names" in refused(path, like="mjlab")
    with_metadata(path, mjlab_metadata(list(facts.JOINT_NAMES), action_scale="0.2,0.3"))
    assert "action_scale has 2 values" in str(invoke("import", str(path), "--like", "mjlab", code=1).exception)
    (tmp_path / "env.yaml").write_text("!!python/object/apply:os.system ['true']\n")
    assert "no mapping" in refused(path)


def test_nothing_is_written_without_a_yes_and_nothing_overwritten(run: Callable[..., Path]) -> None:
    path = run(environment())
    told = CliRunner().invoke(app, ["import", str(path), "--like", "isaac-lab"], input="n\n")
    assert isinstance(told.exception, BadInputError)
    assert not path.with_name("policy.spot.onnx").exists()
    invoke("import", str(path), "--like", "isaac-lab", "--yes")
    shutil.copy(path, path.with_name("other.onnx"))
    told = invoke("import", str(path), "--like", "isaac-lab", "--yes", code=1)
    assert "exists" in str(told.exception)
