"""The next recording: what is in doubt, what a recording leaves of it, the gate, and what the logs hold already."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from diagnosis.command import diagnose
from diagnosis.document import CalibratedNumber, Calibration, Difference, Number, Split, Verdict
from diagnosis.library.registry import LIBRARY
from diagnosis.next import menu as weighing
from diagnosis.next.candidates import HEAT, SHIFTS, candidates, given
from diagnosis.next.doubts import Doubt, doubts_of
from diagnosis.next.files import _lines, _written, load_motion, opened
from diagnosis.next.menu import Diagnosed, Menu, Recording, board_of, scatter_of, through_gate, weighed, weighed_one
from diagnosis.next.trial import ROBOTS, burden, is_held, refusals, try_on, wide_robots
from diagnosis.session import Inputs
from diagnosis.verdict.explanation import evidence_of
from diagnosis.verdict.posterior_file import Posterior
from spot_log.read.run import Run
from spot_model.effects.base import Motion
from spot_model.effects.drivetrain import TorqueGain
from spot_model.effects.friction import ViscousFriction
from spot_model.effects.torque_limits import PositionTorqueLimit
from spot_model.errors import BadInputError
from spot_model.io.joint_experiment import Squat, load_joint_experiment
from spot_model.io.model_file import RobotModel
from spot_model.io.velocity_sequence import load_sequence, sequence_of
from spot_model.policy.contract import PolicyContract, StoredPair
from spot_model.policy.policy import load_policy
from spot_model.robot import facts
from spot_model.robot.facts import JOINT_NAMES

from .report_case import verdict

WALK = Path(__file__).parents[2] / "policies" / "walk.onnx"
SQUAT = Squat(name="squat", duration_s=4.0, depth_m=0.12, frequency_hz=0.8)
DRAGGING = RobotModel((ViscousFriction(joints=("knees",), damping_nm_s_per_rad=0.3),))
NUMBER = ("viscous_friction", "damping_nm_s_per_rad", "")
KNEES = tuple(j for j in JOINT_NAMES if j.endswith("kn"))


def posterior() -> Posterior:
    """Dragging knees alone."""
    term = {"effect": "viscous_friction", "joints": ["knees"], "shape": {}, "mean": [0.3], "covariance": [[0.01]]}
    own = {"weight": 1.0, "distance_floors": None, "model": RobotModel().to_data(), "terms": [term]}
    return Posterior.model_validate({"schema": "spot-rl/posterior/2", "possibilities": [own]})


def dragging(half: float = 0.2, **more: Any) -> Verdict:
    """A verdict that says so, with an interval."""
    number = Number(value=0.3, low=0.3 - half, high=0.3 + half, unit="N·m·s/rad")
    given = {"group": ("viscous_friction",), "rivals": {"viscous_friction": 0.9}, **more}
    difference = Difference(
        name="viscous_friction",
        title="viscous friction",
        probability=0.9,
        joints=KNEES,
        split_by="",
        parameters={"damping_nm_s_per_rad": number},
        **given,
    )
    return verdict((), differences=(difference,), calibration=Calibration())


@pytest.fixture(scope="module")
def stood() -> Run:
    """A log of dragging knees that shift their weight."""
    return try_on(SHIFTS.model_copy(update={"duration_s": 4.0}), [DRAGGING], None, 0)[0]


@pytest.fixture(scope="module")
def squatted() -> Run:
    """A log of dragging knees that go down and up."""
    return try_on(SQUAT, [DRAGGING], None, 1)[0]


def diagnosed(*runs: Run, half: float = 0.2) -> Diagnosed:
    """Dragging knees, diagnosed from logs."""
    return Diagnosed(dragging(half), posterior(), (DRAGGING,), RobotModel(), LIBRARY, runs, None)


# What is in doubt ----------------------------------------------------------------------------------------------------


def test_numbers_in_doubt_are_those_that_formulas_leave_room_in() -> None:
    """Of 0.3 N·m·s/rad formulas leave 1.645 · 0.1 · 0.3 = 0.049: of ± 0.06 more than four fifths, of ± 0.063 less."""
    assert [d.key for d in doubts_of(dragging(0.063), LIBRARY)] == [NUMBER]
    assert doubts_of(dragging(0.06), LIBRARY) == ()


@pytest.mark.parametrize(("probability", "is_in_doubt"), [(0.02, False), (0.5, True), (0.98, False)])
def test_the_robots_own_numbers_are_in_doubt_between_odd_and_ordinary(probability: float, is_in_doubt: bool) -> None:
    n = CalibratedNumber(
        effect="armature", parameter="inertia_kg_m2", title="rotor inertia", where="kn", nominal=0.07, value=0.08,
        low=0.06, high=0.10, unit="kg·m²", spread=0.006, probability=probability,
    )  # fmt: skip
    found = doubts_of(verdict((), differences=(), calibration=Calibration(numbers=(n,))), LIBRARY)
    assert [d.told(d.now) for d in found] == (["± 0.02 kg·m²"] if is_in_doubt else [])


@pytest.mark.parametrize(
    ("status", "unknown", "told"),
    [
        ("explained", 0.1, "No number is in doubt"),
        ("unknown_effect", 0.8, "With 80 %"),
        ("cannot_tell", 0.5, "too little"),
    ],
)
def test_where_all_is_settled_nothing_is_simulated(status: str, unknown: float, told: str) -> None:
    settled = dragging(0.01, split=None).model_copy(update={"status": status, "probability_unknown": unknown})
    menu = weighed(diagnosed()._replace(verdict=settled, robots=()), 0, lambda _: None)
    assert (menu.best, menu.recordings) == (None, ())
    assert told in menu.nothing


def test_what_tells_a_group_apart_is_told_where_no_number_is_in_doubt() -> None:
    split = Split(name="fast", text="Walk fast: friction shows.", command="spot-rl collect")
    two = dragging(0.01, group=("viscous_friction", "torque_gain"), split=split)
    menu = weighed(diagnosed()._replace(verdict=two), 0, lambda _: None)
    assert menu.nothing.endswith("To tell apart viscous friction or torque gain: Walk fast: friction shows.")


# What a recording leaves of it ---------------------------------------------------------------------------------------


def known(*runs: Run) -> float:
    """Standard deviation of the knees' drag by these logs."""
    return scatter_of(diagnosed(), board_of(diagnosed(), runs))[NUMBER]


def test_squats_tell_more_beside_weight_shifts_than_the_same_shifts_again(stood: Run, squatted: Run) -> None:
    alone, again, beside = known(stood), known(stood, stood), known(stood, squatted)
    assert again == pytest.approx(alone, rel=0.1)
    assert beside < 0.8 * again


def test_what_is_expected_is_what_logs_of_the_recording_tell(stood: Run, squatted: Run) -> None:
    """Formulas leave 1.645 · 0.1 · 0.3 of the half-width of 0.2; the rest goes with the standard deviation."""
    found, left = diagnosed(stood), 0.04935
    (doubt,) = doubts_of(found.verdict, LIBRARY)
    one = weighed_one(given(SQUAT), found, (doubt,), board_of(found, [stood]), 5)
    ratio = known(stood, squatted) / known(stood)
    assert one.refused == ()
    assert one.after[doubt.key] == pytest.approx(np.hypot(left, ratio * np.sqrt(0.2**2 - left**2)), rel=0.1)


def a_recording(left: float = 0.4, refused: Sequence[str] = (), name: str = "squat") -> Recording:
    """A squat that leaves a share of one number, and nothing less of another."""
    doubts = (
        Doubt(("torque_gain", "gain", ""), "torque gain at all knees: gain", "1", 0.1, 0.03),
        Doubt(("armature", "inertia_kg_m2", "hy"), "reflected rotor inertia, forward hips (hy)", "kg·m²", 0.02, 0.01),
    )
    own = replace(candidates(None, ())[1], motion=SQUAT.model_copy(update={"name": name}))
    loads = "knees with up to 30 N·m, joints at up to 2.0 rad/s"
    return Recording(own, doubts, {doubts[0].key: left * 0.1, doubts[1].key: 0.02}, loads, tuple(refused))


def test_recordings_are_ranked_by_the_mean_share_by_which_numbers_get_narrower() -> None:
    """(0.6 + 0) / 2."""
    assert a_recording(0.4).gain == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("left", "refused", "is_worth"), [(0.79, (), True), (0.81, (), False), (0.4, ("tips",), False)]
)
def test_a_fifth_narrower_is_worth_running(left: float, refused: tuple[str, ...], is_worth: bool) -> None:
    assert a_recording(left, refused).is_worth is is_worth


def menu_of(monkeypatch: pytest.MonkeyPatch, made: Sequence[Recording], refused: Sequence[str] = ()) -> Menu:
    """The menu of these recordings, of which the gate refuses some."""
    by_name = {r.candidate.name: r for r in made}
    monkeypatch.setattr(weighing, "board_of", lambda *_: None)
    monkeypatch.setattr(weighing, "menu_of", lambda *_: [r.candidate for r in made])
    monkeypatch.setattr(weighing, "weighed_one", lambda c, *_: by_name[c.name])
    monkeypatch.setattr(
        weighing, "through_gate", lambda r, *_: r._replace(refused=("tips",)) if r.candidate.name in refused else r
    )
    return weighed(diagnosed(), 0, lambda _: None)


def test_the_best_passes_the_gate_or_the_next_does(monkeypatch: pytest.MonkeyPatch) -> None:
    made = [a_recording(left, name=name) for left, name in ((0.7, "a"), (0.3, "b"), (0.5, "c"))]
    for refused, best in (((), "b"), (("b",), "c"), (("b", "c"), "a")):
        menu = menu_of(monkeypatch, made, refused)
        assert menu.best is not None
        assert menu.best.candidate.name == best


def test_nothing_worth_running_is_an_answer_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    menu = menu_of(
        monkeypatch, [a_recording(0.9, name="a"), a_recording(0.95, name="b"), a_recording(0.4, ("tips",), "c")]
    )
    assert menu.best is None
    assert menu.nothing == (
        "Most is expected of a. Torque gain at all knees: gain: ± 0.1 now, ± 0.09 expected. 20 % less is the least "
        "that is worth a recording; c is refused: tips."
    )
    assert _lines(menu) == [f"nothing worth running: {menu.nothing}"]


# The gate ------------------------------------------------------------------------------------------------------------


def test_robots_of_the_gate_stand_and_squat(stood: Run) -> None:
    *_, board = evidence_of([stood], RobotModel(), None, LIBRARY)
    robots = wide_robots([RobotModel()], board, np.random.default_rng(0))
    assert len(robots) == ROBOTS
    assert len({repr(robot) for robot in robots}) == ROBOTS
    assert refusals(try_on(SQUAT, robots[:2], None, 0)) == ()


def test_a_recording_that_makes_a_weak_robot_collapse_is_refused_with_the_reason() -> None:
    weak = RobotModel((TorqueGain(joints=("knees",), gain=0.15),))
    told = refusals(try_on(SQUAT, [RobotModel((TorqueGain(joints=("knees",), gain=1.0 - 1e-9),)), weak], None, 0))
    assert told
    assert told[0].startswith("1 of 2 simulated robots ")


def test_what_a_robot_bears_as_it_comes_down_on_its_feet_is_no_load_of_the_recording(squatted: Run) -> None:
    load = squatted.states.load_nm.copy()
    load[0] = 300.0
    dropped = replace(squatted, states=replace(squatted.states, load_nm=load))
    assert burden([dropped]) == burden([squatted])
    assert refusals([dropped]) == ()


def test_a_refusal_names_the_joint_that_is_loaded_most(squatted: Run) -> None:
    load = squatted.states.load_nm.copy()
    load[-1, facts.JOINT_NAMES.index("hr_hy")] = 60.0
    load[-1, facts.JOINT_NAMES.index("fl_kn")] = 120.0
    told = refusals([squatted, replace(squatted, states=replace(squatted.states, load_nm=load))])
    assert told == ("1 of 2 simulated robots load hr_hy with 120 % of what it may carry",)


def test_a_simulation_that_broke_leaves_the_others_alone() -> None:
    """A joint position that is no number gives some finite limit, and the other robots' are what they were."""
    effect = PositionTorqueLimit(motor_torque_nm=1.5)
    position = np.tile(facts.DEFAULT_POSITION_RAD, (2, 1))
    asked = np.full((2, 12), 500.0)
    sound, _ = effect.torque(asked, Motion(position, np.zeros((2, 12)), 0.001), effect.start(asked))
    position[1] = np.nan
    broken, _ = effect.torque(asked, Motion(position, np.zeros((2, 12)), 0.001), effect.start(asked))
    np.testing.assert_array_equal(broken[0], sound[0])


def contract(top_m_s: float = 2.0) -> PolicyContract:
    """Of a policy that walks at up to so many m/s."""
    pair = StoredPair(observation=(0.0,) * 48, action=(0.0,) * 12)
    return PolicyContract(
        name="p", velocity_command_low=(-1.0, -0.6, -1.0), velocity_command_high=(top_m_s, 0.6, 1.0), stored_pair=pair
    )


def test_a_walk_without_a_policy_is_refused() -> None:
    with pytest.raises(BadInputError, match="give the policy"):
        try_on(candidates(contract(), ())[0].motion, [RobotModel()], None, 0)


def test_the_menu_is_of_what_is_there_and_in_doubt() -> None:
    assert [c.name for c in candidates(contract(), ("fl_kn",))] == [
        "sprint", "to_and_fro", "turns", "slow_walk", "standing", "squat", "sweep_fl_kn"
    ]  # fmt: skip
    assert {c.name for c in candidates(None, (), (HEAT,))} == {"standing", "squat", "warm_up"}


def test_dragging_have_knees_swept() -> None:
    names = [c.name for c in weighing.menu_of(diagnosed(), doubts_of(dragging(), LIBRARY))]
    assert names == ["standing", "squat", "sweep_fl_kn", "sweep_fr_kn", "sweep_hl_kn"]


@pytest.mark.parametrize("top_m_s", [0.3, 0.5, 0.8, 1.6, 5.0])
def test_walks_stay_within_the_policys_range_whatever_its_top_speed(top_m_s: float) -> None:
    own = contract(top_m_s)
    for candidate in candidates(own, ())[:3]:
        asked = candidate.motion.clipped(np.array(own.velocity_command_low), np.array(own.velocity_command_high))  # type: ignore[union-attr]
        assert asked == candidate.motion


# What the logs hold --------------------------------------------------------------------------------------------------


def walked(*points: Sequence[float], seed: int = 0) -> Run:
    """A simulated walk of 4 s through these commands."""
    return try_on(sequence_of("w", 4.0, (0.0,), *points, is_ramped=True), [RobotModel()], load_policy(WALK), seed)[0]


def asking(run: Run, command: np.ndarray) -> Run:
    """The same log with other commands."""
    return replace(run, ticks=replace(run.ticks, velocity_command=command))


def test_what_a_log_holds_is_as_fast_in_every_direction_and_changes_as_much(squatted: Run) -> None:
    log = walked((1.0, 0.5), (3.0, 0.5))
    command = log.ticks.velocity_command
    assert is_held(log, [squatted, log])
    assert is_held(asking(log, 0.6 * command), [log])
    assert not is_held(asking(log, 1.3 * command), [log])
    assert not is_held(asking(log, -command), [log])
    assert not is_held(asking(log, command[:, [1, 0, 2]]), [log])
    back_and_forth = command * (np.arange(len(command)) // 10 % 2)[:, None]
    assert not is_held(asking(log, back_and_forth), [log])
    fallen = log.states.odom_from_body_wxyz.copy()
    fallen[-50:] = (0.0, 1.0, 0.0, 0.0)
    assert not is_held(log, [replace(log, states=replace(log.states, odom_from_body_wxyz=fallen))])


def test_standing_recordings_are_held_by_their_own_kind(stood: Run, squatted: Run) -> None:
    assert is_held(squatted, [try_on(SQUAT, [RobotModel()], None, 7)[0]])
    assert not is_held(squatted, [stood])
    assert not is_held(try_on(SQUAT.model_copy(update={"depth_m": 0.15}), [DRAGGING], None, 3)[0], [squatted])


def test_what_the_logs_hold_is_never_refused(squatted: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: Sequence[Run]) -> tuple[str, ...]:
        return ("1 of 1 simulated robots tip over",)

    monkeypatch.setattr(weighing, "refusals", refuse)
    found = diagnosed(squatted, half=0.01)
    board = board_of(found, found.runs)
    for candidate, refused in ((given(SQUAT), ()), (candidates(None, ())[0], refuse(()))):
        one = weighed_one(candidate, found, (), board, 0)
        assert one.refused == refused
        assert one.is_held is not bool(refused)
    assert through_gate(weighed_one(given(SQUAT), found, (), board, 0), found, board, 0).refused == ()


# Files ---------------------------------------------------------------------------------------------------------------


def write(path: Path, **data: object) -> Path:
    path.write_text(yaml.safe_dump(data))
    return path


JOINT = {"schema": "spot-rl/joint-experiment/1", "name": "own"}
UNSAFE = {
    "too deep": {**JOINT, "kind": "squat", "duration_s": 8.0, "depth_m": 0.3},
    "too wide": {**JOINT, "kind": "sweep", "duration_s": 10.0, "joint": "fl_kn", "amplitude_rad": 1.0},
    "too stiff": {**JOINT, "kind": "squat", "duration_s": 8.0, "kp_nm_per_rad": 600.0},
    "too little damping": {**JOINT, "kind": "squat", "duration_s": 8.0, "kd_nm_s_per_rad": 0.0},
    "too strong": {**JOINT, "kind": "squat", "duration_s": 8.0, "torque_nm": 150.0},
    "no number": {**JOINT, "kind": "squat", "duration_s": 8.0, "depth_m": float("nan")},
}


@pytest.mark.parametrize("data", UNSAFE.values(), ids=UNSAFE)
def test_an_unsafe_recording_of_a_users_own_is_refused_by_its_file(tmp_path: Path, data: dict[str, object]) -> None:
    with pytest.raises(BadInputError, match=r"own.yaml:\n"):
        load_motion(write(tmp_path / "own.yaml", **data))


def walk_file(folder: Path, duration_s: float, speed_m_s: float) -> Path:
    points = [{"time_s": 0.0, "v_x_m_s": speed_m_s}]
    schema = "spot-rl/velocity-sequence/1"
    return write(folder / "own.yaml", schema=schema, name="own", duration_s=duration_s, waypoints=points)


def test_what_no_robot_can_do_is_refused_with_the_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The set-point swings by 0.6 rad at up to 5 Hz: 0.6 · 2π · 5 = 18.8 rad/s. The policy walks at 1.7 m/s at most."""
    swing = {"kind": "sweep", "duration_s": 10.0, "joint": "fl_kn", "amplitude_rad": 0.6, "end_hz": 5.0}
    monkeypatch.setattr(weighing, "board_of", lambda *_: None)
    found = diagnosed()._replace(policy=load_policy(WALK), verdict=dragging(0.01))
    for file, told in (
        (write(tmp_path / "swing.yaml", **JOINT, **swing), "fl_kn"),
        (walk_file(tmp_path, 5.0, 9.0), "(m/s), ω_z (rad/s) from -0.8, -0.5, -1 to 1.7, 0.5, 1"),
    ):
        menu = weighed(found, 0, lambda _: None, load_motion(file))
        assert menu.best is None
        assert told in menu.recordings[0].refused[0]
        assert "is refused" in menu.nothing


@pytest.mark.parametrize("duration_s", [0.5, 3600.0])
def test_a_walk_that_nobody_would_wait_for_is_refused_before_it_is_simulated(tmp_path: Path, duration_s: float) -> None:
    with pytest.raises(BadInputError, match=f"duration_s is {duration_s:g}; allowed: 4 to 60 s"):
        load_motion(walk_file(tmp_path, duration_s, 0.5))


def test_the_name_of_a_users_own_recording_leads_to_no_other_folder() -> None:
    """Its file is written under its name."""
    assert given(SQUAT.model_copy(update={"name": "../../a b/ü"})).name == "_a_b_ü"


def test_files_and_commands_of_a_menu(tmp_path: Path) -> None:
    inputs = Inputs(logs=("/logs",), nominal="ideal", policy="/p.onnx")
    best = a_recording()
    commands = _written(Menu(best, (best, a_recording(0.9, ("tips",)))), inputs, tmp_path, Path("place"))
    assert commands == [
        "spot-rl run --experiment place/squat.yaml --log-dir MORE_LOGS --robot HOST",
        "spot-rl diagnose /logs MORE_LOGS --nominal ideal --out OUT_2",
    ]
    assert load_joint_experiment(tmp_path / "squat.yaml") == best.candidate.motion
    told = json.loads((tmp_path / "menu.json").read_text())
    assert (told["best"], [r["refused"] for r in told["recordings"]]) == ("squat", [[], ["tips"]])
    assert told["recordings"][0]["numbers"][0]["expected"] == pytest.approx(0.04)
    walk = best._replace(candidate=candidates(contract(), ())[0])
    commands = _written(Menu(walk, (walk,)), inputs, tmp_path, tmp_path)
    assert commands[0].startswith(f"spot-rl run --policy /p.onnx --sequence {tmp_path / 'sprint.yaml'} ")
    assert load_sequence(str(tmp_path / "sprint.yaml")) == walk.candidate.motion


# The command line ----------------------------------------------------------------------------------------------------


def test_words_that_are_no_command_are_logs(tmp_path: Path) -> None:
    (tmp_path / "verdict.json").write_text("{}")
    words = [str(tmp_path / "a.mcap"), "--nominal", "ideal", "--out", str(tmp_path)]
    assert "there is no log" in str(CliRunner().invoke(diagnose, words).exception)
    (tmp_path / "a.mcap").touch()
    assert "verdict.json exists" in str(CliRunner().invoke(diagnose, words).exception)


def test_a_folder_without_a_diagnosis_is_named(tmp_path: Path) -> None:
    assert "inputs.json cannot be read" in str(CliRunner().invoke(diagnose, ["next", str(tmp_path)]).exception)


def test_a_diagnosis_of_another_release_or_robot_is_named(tmp_path: Path) -> None:
    Inputs(logs=(str(tmp_path / "a.mcap"),), nominal="ideal").save(tmp_path)
    with pytest.raises(BadInputError, match=r"holds no verdict.json"):
        opened(tmp_path)
    for name in ("verdict.json", "posterior.json", "possible_robots.yaml"):
        (tmp_path / name).write_text('{"schema": "spot-rl/verdict/0"}')
    with pytest.raises(BadInputError, match="another release"):
        opened(tmp_path)
