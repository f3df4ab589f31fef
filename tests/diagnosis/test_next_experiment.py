"""The next experiment: information by hand, safety, the choice, the rounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from diagnosis.command import diagnose
from diagnosis.decision_constants import ODD_RUN
from diagnosis.library.registry import LIBRARY
from diagnosis.next import design as choice
from diagnosis.next import rounds as robot_rounds
from diagnosis.next.candidates import HEAT, Candidate, candidates, given
from diagnosis.next.design import Design, Information, Proposal, in_words, information_of, judged
from diagnosis.next.files import free_folder, load_motion, ranking_lines, run_words, write_offers
from diagnosis.next.page import ranking_page, story_page
from diagnosis.next.robots import (
    N_WIDE,
    Robots,
    beliefs,
    compact,
    drawn_robots,
    suspects,
    with_ordinary_errors,
)
from diagnosis.next.rounds import (
    SURE,
    WHOLE,
    Answer,
    Lab,
    Limits,
    RobotRun,
    Story,
    ask_robot,
    is_here,
    read_story,
    run_on_robot,
)
from diagnosis.next.session import Session, found_in
from diagnosis.next.trial import _roughness, refusals, try_on
from diagnosis.session import Inputs
from diagnosis.verdict.posterior_file import Posterior, load_posterior
from spot_model.effects.base import Motion
from spot_model.effects.drivetrain import TorqueGain
from spot_model.effects.torque_limits import PositionTorqueLimit
from spot_model.errors import BadInputError
from spot_model.io.joint_experiment import Squat, load_joint_experiment
from spot_model.io.model_file import RobotModel, load_model
from spot_model.policy.policy import load_policy
from spot_model.process.signals import Ended
from spot_model.robot import facts
from spot_model.robot.facts import JOINT_NAMES

WALK = Path(__file__).parents[2] / "policies" / "walk.onnx"


def posterior(**weights: float) -> Posterior:
    """Ordinary errors (``none``) and single effects at the knees with one number each, by weight."""
    numbers = {"torque_gain": 0.3, "viscous_friction": 1.5, "armature": 0.05}
    possibilities = []
    for name, weight in weights.items():
        terms = []
        if name != "none":
            n = len(LIBRARY[name].coefficients)
            mean = [numbers[name] * (-1.0 if name == "torque_gain" else 1.0)] + [0.0] * (n - 1)
            cov = np.zeros((n, n)).tolist()
            terms = [{"effect": name, "joints": ["knees"], "shape": {}, "mean": mean, "covariance": cov}]
        data = RobotModel().to_data()
        possibilities.append({"weight": weight, "distance_floors": None, "model": data, "terms": terms})
    return Posterior.model_validate({"schema": "spot-rl/posterior/2", "possibilities": possibilities})


# What an experiment tells --------------------------------------------------------------------------------------------


def test_robots_that_are_far_apart_tell_all_that_odd_runs_leave() -> None:
    """Two causes, each 1/2: one bit, of which odd runs take a tenth."""
    rng = np.random.default_rng(0)
    causes = np.repeat([0, 1], 12)
    far = 1000.0 * causes[:, None] * np.ones((1, 5)) + rng.standard_normal((24, 5))
    told = information_of(far, causes, np.array([0.5, 0.5]), rng)
    assert told.of_bits == pytest.approx(1.0)
    assert told.bits == pytest.approx(1.0 - ODD_RUN, abs=1e-3)
    assert told.right(0, 1) == pytest.approx(1.0 - 0.5 * ODD_RUN, abs=1e-3)


def test_one_number_of_two_hundred_is_found_and_its_distance_is_right() -> None:
    """Means 8 apart, scatter 1 and formulas 1 more: Δ = 8/√2 = 5.7, less what 15 % of the difference add."""
    rng = np.random.default_rng(3)
    causes = np.repeat([0, 1], 12)
    x = rng.standard_normal((24, 200))
    x[:, 17] += 8.0 * causes
    told = information_of(x, causes, np.array([0.5, 0.5]), rng)
    assert 3.0 < told.apart[0, 1] < 6.5


def test_robots_that_are_alike_tell_nothing() -> None:
    rng = np.random.default_rng(1)
    causes = np.repeat([0, 1, 2], 12)
    told = information_of(rng.standard_normal((36, 40)), causes, np.array([0.6, 0.3, 0.1]), rng)
    assert told.bits < 0.05


@pytest.mark.parametrize(("share", "is_enough"), [(0.71, False), (0.73, True)])
def test_four_fifths_of_what_a_run_can_tell_are_enough(share: float, is_enough: bool) -> None:
    """One run in ten is odd: of two bits a run can tell 1.8, and 0.8 · 1.8 = 1.44 = 0.72 · 2."""
    assert Information(share * 2.0, 2.0, np.zeros((3, 3))).is_enough is is_enough


def test_what_is_nearly_certain_leaves_little_to_tell() -> None:
    rng = np.random.default_rng(2)
    causes = np.repeat([0, 1], 12)
    far = 1000.0 * causes[:, None] * np.ones((1, 5))
    told = information_of(far, causes, np.array([0.98, 0.02]), rng)
    assert told.bits <= told.of_bits < 0.15


# Robots that the logs allow ------------------------------------------------------------------------------------------


def test_causes_and_suspects_of_a_posterior() -> None:
    own = posterior(torque_gain=0.6, viscous_friction=0.395, armature=0.005)
    assert list(beliefs(own)) == [("torque_gain",), ("viscous_friction",)]
    assert sum(beliefs(own).values()) == pytest.approx(1.0)
    assert set(suspects(own)) == {"fl_kn", "fr_kn", "hl_kn", "hr_kn"}
    assert suspects(posterior(none=1.0)) == JOINT_NAMES[:3]


def test_every_cause_gets_as_many_robots_and_a_seed_gives_the_same_ones() -> None:
    own = posterior(torque_gain=0.7, none=0.3)
    first, second = (drawn_robots(own, 3, np.random.default_rng(5)) for _ in range(2))
    assert first.cause_of.tolist() == [0, 0, 0, 1, 1, 1]
    assert len(first.wide) == N_WIDE
    assert repr((first.models, first.wide)) == repr((second.models, second.wide))


def test_effects_at_single_joints_become_one_and_act_as_before() -> None:
    apart = RobotModel(tuple(TorqueGain(joints=(n,), gain=0.9 + 0.01 * i) for i, n in enumerate(JOINT_NAMES)))
    together = compact(apart)
    assert len(together.effects) == 1
    np.testing.assert_allclose(together.effects[0].gain[0], 0.9 + 0.01 * np.arange(12))  # type: ignore[attr-defined]
    both = [RobotModel((*m.effects,)) for m in (apart, together)]
    runs = [try_on(SQUAT, [m], None, np.random.default_rng(0))[0] for m in both]
    np.testing.assert_array_equal(runs[0].states.position_rad, runs[1].states.position_rad)


def test_no_ordinary_robot_has_less_inertia_than_none() -> None:
    """Half a kilogram less, half a metre above the body, would turn the sign of its inertia."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        for effect in with_ordinary_errors(RobotModel(), rng, 2.0).effects:
            if effect.name == "payload_mass" and effect.values["mass_kg"] < 0.0:
                assert (effect.values["x_m"], effect.values["y_m"], effect.values["z_m"]) == (0.0, 0.0, 0.0)


# Safety --------------------------------------------------------------------------------------------------------------

SQUAT = Squat(name="squat", duration_s=4.0, depth_m=0.06)


def test_ordinary_robots_bear_a_squat() -> None:
    rng = np.random.default_rng(0)
    models = [compact(with_ordinary_errors(load_model("paper_identified"), rng, 1.0)) for _ in range(4)]
    assert refusals(try_on(SQUAT, models, None, rng)) == ()


def test_an_experiment_that_makes_a_weak_robot_collapse_is_refused_with_the_reason() -> None:
    weak = RobotModel((TorqueGain(joints=("knees",), gain=0.15),))
    models = [RobotModel((TorqueGain(joints=("knees",), gain=1.0 - 1e-9),)), weak]
    told = refusals(try_on(SQUAT, models, None, np.random.default_rng(0)))
    assert told
    assert told[0].startswith("1 of 2 simulated robots ")


def test_a_refusal_names_the_joint_that_is_loaded_most() -> None:
    run = try_on(SQUAT, [RobotModel()], None, np.random.default_rng(0))[0]
    load = run.states.load_nm.copy()
    load[-1, facts.JOINT_NAMES.index("hr_hy")] = 60.0
    load[-1, facts.JOINT_NAMES.index("fl_kn")] = 120.0
    told = refusals([run, replace(run, states=replace(run.states, load_nm=load))])
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


def test_a_walk_without_a_policy_is_refused() -> None:
    walk = next(c for c in candidates(_contract(), ("fl_kn",)) if c.name == "sprint").motion()
    with pytest.raises(BadInputError, match="give the policy"):
        try_on(walk, [RobotModel()], None, np.random.default_rng(0))


def _contract():  # type: ignore[no-untyped-def]
    from spot_model.policy.contract import PolicyContract, StoredPair

    pair = StoredPair(observation=(0.0,) * 48, action=(0.0,) * 12)
    return PolicyContract(
        name="p", velocity_command_low=(-1.0, -0.6, -1.0), velocity_command_high=(2.0, 0.6, 1.0), stored_pair=pair
    )


@pytest.mark.parametrize("candidate", candidates(_contract(), JOINT_NAMES[:3], (HEAT,)), ids=lambda c: c.name)
def test_every_corner_of_a_candidates_bounds_can_be_built(candidate: Candidate) -> None:
    for side in ("start", "low"):
        values = {name: getattr(free, side) for name, free in candidate.free.items()}
        motion = replace(candidate, values=values).motion()
        assert 4.0 <= motion.duration_s <= (40.0 if candidate.name == "warm_up" else 20.0)


@pytest.mark.parametrize("top_m_s", [0.3, 0.5, 0.8, 1.6, 5.0])
def test_to_and_fro_starts_within_its_bounds_whatever_the_policys_top_speed(top_m_s: float) -> None:
    contract = _contract().model_copy(update={"velocity_command_high": (top_m_s, 0.6, 1.0)})
    speed = next(c for c in candidates(contract, ()) if c.name == "to_and_fro").free["speed_m_s"]
    assert speed.low <= speed.start <= speed.high <= top_m_s


def test_motors_are_warmed_only_where_heat_may_be_the_cause() -> None:
    def names(*effects: str) -> set[str]:
        return {c.name for c in candidates(_contract(), (), effects)}

    assert names(HEAT) - names("torque_gain") == {"warm_up"}


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
def test_an_unsafe_experiment_of_a_users_own_is_refused_by_its_file(tmp_path: Path, data: dict[str, object]) -> None:
    with pytest.raises(BadInputError, match=r"own.yaml:\n"):
        load_motion(write(tmp_path / "own.yaml", **data))


def test_one_that_only_its_motion_makes_unsafe_is_refused_with_the_reason(tmp_path: Path) -> None:
    """The set-point swings by 0.6 rad at up to 5 Hz: 0.6 · 2π · 5 = 18.8 rad/s."""
    swing = {"kind": "sweep", "duration_s": 10.0, "joint": "fl_kn", "amplitude_rad": 0.6, "end_hz": 5.0}
    own = given(load_motion(write(tmp_path / "own.yaml", **JOINT, **swing)))
    robots = drawn_robots(posterior(torque_gain=1.0), 1, np.random.default_rng(0))
    refused = judged(own, robots, None, 0).refused
    assert len(refused) == 1
    assert "fl_kn" in refused[0]


def test_a_walk_beyond_the_policys_range_is_refused_with_the_range(tmp_path: Path) -> None:
    points = [{"time_s": 0.0, "v_x_m_s": 9.0}]
    file = write(
        tmp_path / "own.yaml", schema="spot-rl/velocity-sequence/1", name="own", duration_s=5.0, waypoints=points
    )
    robots = drawn_robots(posterior(torque_gain=1.0), 1, np.random.default_rng(0))
    refused = judged(given(load_motion(file)), robots, load_policy(WALK), 0).refused
    assert len(refused) == 1
    assert refused[0].endswith("(m/s), ω_z (rad/s) from -0.8, -0.5, -1 to 1.7, 0.5, 1")


@pytest.mark.parametrize("duration_s", [0.5, 3600.0])
def test_a_walk_that_nobody_would_wait_for_is_refused_before_it_is_simulated(tmp_path: Path, duration_s: float) -> None:
    points = [{"time_s": 0.0, "v_x_m_s": 0.5}]
    file = write(
        tmp_path / "own.yaml", schema="spot-rl/velocity-sequence/1", name="own", duration_s=duration_s, waypoints=points
    )
    with pytest.raises(BadInputError, match=f"duration_s is {duration_s:g}; allowed: 4 to 60 s"):
        load_motion(file)


def test_the_name_of_a_users_own_experiment_leads_to_no_other_folder() -> None:
    """Its file is written under its name."""
    assert given(SQUAT.model_copy(update={"name": "../../a b/ü"})).name == "_a_b_ü"


# The choice ----------------------------------------------------------------------------------------------------------


def test_a_squat_tells_a_weak_knee_from_a_sound_one() -> None:
    own = posterior(torque_gain=0.5, none=0.5)
    robots = drawn_robots(own, 8, np.random.default_rng(0))
    squat = next(c for c in candidates(None, ("fl_kn",)) if c.name == "squat")
    proposal = judged(replace(squat, values={"duration_s": 6.0}), robots, None, 0)
    assert proposal.refused == ()
    assert proposal.told.bits > 0.3
    assert "torque gain from ordinary errors alone" in proposal.decides(robots.causes, robots.weights) or (
        "ordinary errors alone from torque gain" in proposal.decides(robots.causes, robots.weights)
    )


def made_design(bits: dict[str, float], refused: Sequence[str] = ()) -> Design:
    """A design with squats of these names."""
    squat = next(c for c in candidates(None, ("fl_kn",)) if c.name == "squat")
    made = []
    for name, told in bits.items():
        own = Candidate(name, name, "level ground", squat.free, squat.build)
        apart = np.array([[0.0, 2.0], [2.0, 0.0]])
        reasons = ("1 of 2 simulated robots tip over",) if name in refused else ()
        made.append(
            Proposal(own, own.motion(), Information(told, 1.0, apart), "knee up to 30 N·m", reasons, is_proved=True)
        )
    made.sort(key=lambda p: (bool(p.refused), -p.bits_a_second))
    return Design((("torque_gain",), ()), np.array([0.6, 0.4]), tuple(made))


def test_the_best_is_the_most_telling_that_is_safe() -> None:
    plan = made_design({"a": 0.2, "b": 0.5, "c": 0.9}, refused=("c",))
    assert [p.candidate.name for p in plan.worthwhile] == ["b", "a"]
    assert made_design({"a": 0.01}).worthwhile == ()


def test_what_was_not_proved_on_robots_with_wide_errors_is_not_run() -> None:
    plan = made_design({"a": 0.5})
    unproved = replace(plan.proposals[0], is_proved=False)
    assert unproved.is_promising
    assert replace(plan, proposals=(unproved,)).worthwhile == ()


@pytest.mark.parametrize(("weights", "each"), [((1.0,), 12), ((0.6, 0.4), 12), ((0.5, 0.3, 0.2), 8)])
def test_causes_share_the_robots(monkeypatch: pytest.MonkeyPatch, weights: tuple[float, ...], each: int) -> None:
    """24 in all, and no more of a single cause than of two."""
    asked: list[int] = []

    def draw(own: Posterior, n: int, rng: np.random.Generator) -> Robots:
        asked.append(n)
        return Robots(tuple(beliefs(own)), np.array([*beliefs(own).values()]), (), np.zeros(0), ())

    monkeypatch.setattr(choice, "drawn_robots", draw)
    monkeypatch.setattr(choice, "candidates", lambda *_: [])
    names = ("torque_gain", "viscous_friction", "armature")
    choice.design(posterior(**dict(zip(names, weights, strict=False))), None, 0)
    assert asked == [each]


def test_a_rougher_load_shows_in_the_signature() -> None:
    """White noise of 1 N·m: second differences have a variance of 1 + 4 + 1 = 6."""
    rough = _roughness(np.random.default_rng(0).standard_normal((4000, 12)))
    assert rough == pytest.approx(1.0, abs=0.05)
    assert _roughness(np.linspace(0.0, 50.0, 4000)[:, None] * np.ones(12)) == pytest.approx(0.0, abs=1e-9)


def test_where_one_experiment_is_wanted_the_best_is_proved_and_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of three that last as long, b tells most."""
    names: list[str] = []

    def prove(proposal: Proposal, *_: object) -> Proposal:
        names.append(proposal.candidate.name)
        return replace(proposal, is_proved=True)

    plan = made_design({"a": 0.5, "b": 0.9, "c": 0.7})
    found = iter([replace(p, is_proved=False) for p in plan.proposals])
    monkeypatch.setattr(choice, "proved", prove)
    monkeypatch.setattr(choice, "judged", lambda *_: next(found))
    monkeypatch.setattr(choice, "candidates", lambda *_: [p.candidate for p in plan.proposals])
    made = choice.design(posterior(torque_gain=1.0), None, 0, wanted=1)
    assert names == ["b"]
    assert [p.candidate.name for p in made.worthwhile] == ["b"]


@pytest.mark.parametrize("refused", [(), ("1 of 2 simulated robots tip over",)])
def test_a_users_own_experiment_is_run_whatever_it_tells_if_it_is_safe(refused: tuple[str, ...]) -> None:
    own = Proposal(given(SQUAT), SQUAT, Information(0.0, 1.0, np.zeros((2, 2))), "", refused, is_proved=True)
    plan = Design((("torque_gain",), ()), np.array([0.6, 0.4]), (own,))
    assert plan.worthwhile == (() if refused else (own,))
    assert ranking_lines(plan, {})[4] == f"1. {SQUAT.name}, from a file", "a file's numbers are not ours to list"


def test_files_commands_and_pages_of_a_ranking(tmp_path: Path) -> None:
    plan = made_design({"a": 0.2, "bad": 0.9}, refused=("bad",))
    commands = write_offers(plan, tmp_path, tmp_path, None)
    file = tmp_path / "01_a.yaml"
    assert list(tmp_path.glob("*.yaml")) == [file]
    assert load_joint_experiment(file) == plan.proposals[0].motion
    told = "\n".join(ranking_lines(plan, commands))
    assert "refused: 1 of 2 simulated robots tip over" in told
    assert f"spot-rl run --experiment {file}" in told
    page = ranking_page(plan, commands)
    assert "tip over" in page
    assert "torque gain" in page
    assert free_folder(tmp_path, "next").name == "next"
    assert free_folder(tmp_path, "next").name == "next-2"


def test_a_walk_is_run_by_its_policy() -> None:
    walk = candidates(_contract(), ())[0].motion()
    words = run_words(walk, Path("w.yaml"), "p.onnx", "logs")
    assert words == ["run", "--policy", "p.onnx", "--sequence", "w.yaml", "--log-dir", "logs"]


# The rounds ----------------------------------------------------------------------------------------------------------


class FakeLab:
    """A robot whose every whole run moves the odds by a given step."""

    def __init__(self, folder: Path, odds: list[float], outcomes: list[str] | None = None, agrees: bool = True) -> None:
        self.odds, self.outcomes, self.agrees = odds, outcomes or [WHOLE] * 9, agrees
        self.ran: list[str] = []
        self.excluded: list[list[str]] = []
        self.pages: list[str] = []
        self.story_file = folder / "story.json"
        self.stops_at = ""
        agreed = lambda *_: self.agrees  # noqa: E731
        opened = lambda place: self.found(place, self.odds[int(place.parent.name.removeprefix("round_"))])  # noqa: E731
        self.lab = Lab(folder, self.choose, agreed, self.run, self.diagnose, opened, lambda _: None, self.told)

    def found(self, folder: Path, odds: float) -> Answer:
        return Answer(folder, posterior(torque_gain=odds, none=1.0 - odds), "explained", "words")

    def choose(self, own: Posterior, seed: int, excluded: Sequence[str], left_s: float) -> Design:
        del own, seed, left_s
        if self.stops_at == "choose":
            raise KeyboardInterrupt
        self.excluded.append(list(excluded))
        return made_design({n: b for n, b in (("a", 0.5), ("b", 0.4), ("c", 0.3)) if n not in excluded})

    def run(self, chosen: Proposal, folder: Path) -> RobotRun:
        self.ran.append(chosen.candidate.name)
        outcome = self.outcomes[len(self.ran) - 1]
        log = folder / "logs" / "x.mcap" if outcome != "no log" else None
        return RobotRun(log, 13.0, outcome, outcome == "interrupted")

    def diagnose(self, logs: Sequence[Path], out: Path) -> Answer:
        if self.stops_at == "diagnose":
            raise KeyboardInterrupt
        return self.found(out, self.odds[len(logs)])

    def told(self, story: Story) -> None:
        self.pages.append(story_page(story))
        self.story_file.write_text(story.to_json())

    def ask(self, *, budget_s: float = 100.0, rounds: int = 5) -> Story:
        self.story_file.parent.mkdir(exist_ok=True)
        story = read_story(self.story_file, self.found(Path("first"), self.odds[0]))
        return ask_robot(story, self.lab, Limits(budget_s, rounds), 0)


def test_it_goes_on_until_one_cause_stands(tmp_path: Path) -> None:
    fake = FakeLab(tmp_path, [0.6, 0.8, 0.97])
    story = fake.ask()
    assert fake.ran == ["a", "a"]
    assert story.robot_s == pytest.approx(26.0)
    assert story.ending == "torque gain has a probability of 0.97"
    assert [next(iter(r.after.values())) for r in story.rounds] == pytest.approx([0.8, 0.97])
    assert "Experiment 2" in fake.pages[-1]
    assert "href='round_2/found/report.html'" in fake.pages[-1]
    assert '"ending": "torque gain has a probability of 0.97"' in story.to_json()


def test_a_cause_that_stands_already_asks_for_nothing(tmp_path: Path) -> None:
    fake = FakeLab(tmp_path, [SURE])
    assert fake.ask().rounds == []
    assert fake.ran == []


@pytest.mark.parametrize(("status", "n_rounds"), [("no_gap", 0), ("unknown_effect", 1)])
def test_ordinary_errors_alone_are_an_answer_where_there_is_no_gap(tmp_path: Path, status: str, n_rounds: int) -> None:
    fake = FakeLab(tmp_path, [0.6, 0.97])
    story = Story(Answer(tmp_path, posterior(none=0.97, torque_gain=0.03), status, "words"))
    assert len(ask_robot(story, fake.lab, Limits(100.0, 5), 0).rounds) == n_rounds


def test_the_budget_of_robot_time_ends_it(tmp_path: Path) -> None:
    fake = FakeLab(tmp_path, [0.6, 0.7, 0.8, 0.63])
    story = fake.ask(budget_s=20.0)
    assert len(story.rounds) == 1
    assert "budget of 20 s" in story.ending


def test_a_person_may_decline_and_a_person_may_stop(tmp_path: Path) -> None:
    assert FakeLab(tmp_path / "a", [0.6], agrees=False).ask().ending == "a person declined a"
    stopped = FakeLab(tmp_path / "b", [0.6, 0.7], ["interrupted"]).ask()
    assert stopped.is_interrupted
    assert len(stopped.rounds) == 1
    assert stopped.rounds[0].found


@pytest.mark.parametrize("stage", ["choose", "diagnose"])
def test_after_ctrl_c_another_start_goes_on_with_the_logs_there_are(tmp_path: Path, stage: str) -> None:
    fake = FakeLab(tmp_path, [0.6, 0.8, 0.97])
    fake.ask(rounds=1)
    fake.stops_at = stage
    stopped = fake.ask()
    assert stopped.is_interrupted
    assert "a person stopped it" in fake.pages[-1]
    fake.stops_at = ""
    story = fake.ask()
    assert fake.ran == ["a", "a"]
    assert [bool(r.found) for r in story.rounds] == [True, True]
    assert story.ending == "torque gain has a probability of 0.97"


@pytest.mark.parametrize(
    ("robot", "here"),
    [
        ("127.0.0.1:8443", True),
        ("localhost", True),
        ("[::1]:8443", True),
        ("unix:/run/spot.sock", True),
        ("192.168.80.3", False),
        ("spot.local:8443", False),
    ],
)
def test_nobody_but_a_fake_robot_on_this_computer_moves_without_being_asked_for(robot: str, here: bool) -> None:
    assert is_here(robot) is here


def test_a_robot_elsewhere_is_not_run_without_a_person(tmp_path: Path) -> None:
    words = ["next", str(tmp_path), "--run", "--yes", "--robot", "192.168.80.3"]
    told = CliRunner().invoke(diagnose, words)
    assert isinstance(told.exception, BadInputError)
    assert "a person confirms each run" in str(told.exception)


def test_a_file_that_is_no_story_is_named(tmp_path: Path) -> None:
    fake = FakeLab(tmp_path, [0.6])
    fake.story_file.write_text("{}")
    with pytest.raises(BadInputError, match="is no story"):
        fake.ask()


def test_bits_that_came_by_hand(tmp_path: Path) -> None:
    """0.8 · log₂(0.8/0.6) + 0.2 · log₂(0.2/0.4) = 0.332 − 0.2; what came is never less than nothing."""
    story = FakeLab(tmp_path, [0.6, 0.8, 0.8, 0.97]).ask(rounds=2)
    assert story.rounds[0].came_bits == pytest.approx(0.8 * np.log2(0.8 / 0.6) - 0.2)
    assert story.rounds[1].came_bits == 0.0


def test_experiments_that_fail_are_not_asked_again_and_two_end_it(tmp_path: Path) -> None:
    fake = FakeLab(tmp_path, [0.6, 0.6], ["no log", "tilt"])
    story = fake.ask()
    assert fake.ran == ["a", "b"]
    assert fake.excluded == [[], ["a"]]
    assert "see to the robot" in story.ending


def test_what_told_nothing_is_not_asked_again(tmp_path: Path) -> None:
    fake = FakeLab(tmp_path, [0.6, 0.61, 0.8, 0.97])
    assert fake.ask().ending == "torque gain has a probability of 0.97"
    assert fake.ran == ["a", "b", "b"]


def test_the_number_of_experiments_ends_it(tmp_path: Path) -> None:
    assert FakeLab(tmp_path, [0.6, 0.7, 0.8]).ask(rounds=2).ending == "2 experiments were run"


def test_something_unknown_is_never_one_cause(tmp_path: Path) -> None:
    """A half of it all is unknown: a cause that stands at 0.97 among the known ones stands at 0.485."""
    known = posterior(torque_gain=0.97, none=0.03)
    found = Answer(tmp_path, known.model_copy(update={"unknown": 0.5}), "unknown_effect", "words")
    assert list(found.odds.values()) == pytest.approx([0.5, 0.485, 0.015, 0.0])


def test_many_unlikely_rivals_together_are_not_forgotten(tmp_path: Path) -> None:
    """Thirty rivals of 0.9 % each: the likeliest stands at 0.73, not at 1."""
    own = posterior(torque_gain=0.73, viscous_friction=0.009)
    rival = own.possibilities[1]
    names = [n for n in LIBRARY if n != "torque_gain"][:30]
    rivals = [rival.model_copy(update={"terms": (rival.terms[0].model_copy(update={"effect": n}),)}) for n in names]
    found = Answer(tmp_path, Posterior(possibilities=(own.possibilities[0], *rivals)), "explained", "words")
    assert found.top == ("torque gain", pytest.approx(0.73))
    assert found.odds["others"] == pytest.approx(0.27)


def test_a_run_that_leaves_no_log_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_rounds, "run_in_foreground", lambda _: Ended(0, False))
    ran = run_on_robot(["run"], tmp_path)
    assert (ran.log, ran.outcome) == (None, "it left no log")


# The command line ----------------------------------------------------------------------------------------------------


def test_words_that_are_no_command_are_logs(tmp_path: Path) -> None:
    (tmp_path / "verdict.json").write_text("{}")
    words = [str(tmp_path / "a.mcap"), "--nominal", "ideal", "--out", str(tmp_path)]
    assert "there is no log" in str(CliRunner().invoke(diagnose, words).exception)
    (tmp_path / "a.mcap").touch()
    assert "verdict.json exists" in str(CliRunner().invoke(diagnose, words).exception)


def test_a_folder_without_a_diagnosis_is_named(tmp_path: Path) -> None:
    for words in (["next", str(tmp_path)], ["predict", str(tmp_path), "--sequence", "forward"]):
        assert "inputs.json cannot be read" in str(CliRunner().invoke(diagnose, words).exception)


def test_a_diagnosis_of_another_release_is_named(tmp_path: Path) -> None:
    for name in ("verdict.json", "posterior.json"):
        (tmp_path / name).write_text('{"schema": "spot-rl/verdict/0"}')
    with pytest.raises(BadInputError, match="another release"):
        found_in(tmp_path)


def test_a_second_start_with_other_logs_is_refused(tmp_path: Path) -> None:
    """What is there is of these logs alone; the same command again would go on."""
    (tmp_path / "verdict.json").write_text("{}")
    Inputs(logs=(str(tmp_path / "a.mcap"),), nominal="ideal").save(tmp_path)
    with pytest.raises(BadInputError, match="a diagnosis of other logs"):
        Session.opened(tmp_path, [tmp_path / "b.mcap"], "ideal", None, 0)


def test_a_run_needs_a_robot(tmp_path: Path) -> None:
    assert "give --robot" in str(CliRunner().invoke(diagnose, ["next", str(tmp_path), "--run"]).exception)


def test_a_cause_in_words() -> None:
    assert in_words(()) == "ordinary errors alone"
    assert in_words(("a_b", "c")) == "a b and c"
    assert callable(load_posterior)
