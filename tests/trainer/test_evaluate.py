import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spot_model.effects.base import Effect
from spot_model.effects.bodies import GroundFriction
from spot_model.effects.ground import FootDrag, GroundSlope
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import load_policy
from trainer.evaluate import trials
from trainer.evaluate.command import _evaluated
from trainer.evaluate.page import _how_often, evaluation_page
from trainer.evaluate.setting import FOOT_GEOMS, Setting
from trainer.evaluate.trials import _grid, evaluate_setting
from trainer.simulate.walks import WalkRecord, record_walks

POLICY = Path(__file__).parents[2] / "policies" / "walk.onnx"


def recording(ticks: int = 200) -> WalkRecord:
    command = np.tile([1.0, 0.0, 0.5], (ticks, 2, 1))
    velocity = command + np.array([0.1, -0.2, 0.0])
    # Legs fl and hr on the ground for 3 of 10 ticks, fr and hl for 4; one tick in ten has none.
    phase = np.arange(ticks) % 10
    contact = np.stack([phase < 3, (phase >= 4) & (phase < 8), (phase >= 4) & (phase < 8), phase < 3], axis=-1)
    alive = np.ones((ticks, 2), dtype=np.bool_)
    alive[150:, 1] = False
    # Four physics steps a tick, two robots; in the last step of its last tick the fl foot has left.
    contacts = np.tile(contact[:, None, None], (1, 4, 2, 1))
    contacts[phase == 2, 3, :, 0] = False
    descent = np.where(contacts, 0.0, 0.6)
    return WalkRecord(command, velocity, contacts, descent, np.zeros((ticks, 2)), np.zeros(2), alive, 50.0)


def test_figures_by_hand() -> None:
    r = recording()
    span = r.ticks(0.0, 4.0)
    error = r.tracking_error(span)
    np.testing.assert_allclose(error[0], [0.1, 0.2, 0.0], atol=1e-12)
    assert np.isnan(error[1]).all()
    np.testing.assert_allclose(r.mean_velocity(span)[0], [1.1, -0.2, 0.5])
    figures = r.gait(span, 0)
    assert figures["duty_factors"] == [0.275, 0.4, 0.4, 0.3]
    assert figures["duty_spread"] == 0.125
    assert figures["flight_share"] == 0.3
    assert figures["gait"] == "flying trot"
    assert figures["touchdown_m_s"] == pytest.approx(0.6)
    assert figures["stride_hz"] == pytest.approx(5.0, abs=0.2)
    assert r.survived.tolist() == [True, False]


def test_the_sway_within_a_stride_is_no_error() -> None:
    r = recording()
    sway = 0.3 * np.sin(2 * np.pi * np.arange(200) / 25.0)  # half a second
    r.velocity[:, 0, 0] = 1.0 + sway
    assert r.tracking_error(r.ticks(0.0, 4.0))[0, 0] == pytest.approx(0.0, abs=1e-9)


def test_grid_leaves_out_zero() -> None:
    assert _grid(-1.0, 1.0, 0.5) == [-1.0, -0.5, 0.5, 1.0]


def test_the_committed_walk_walks_and_stands() -> None:
    setting = Setting(load_policy(POLICY), n_threads=1)
    target = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    result = record_walks(setting.policy, setting.plant(2), lambda _: target, 300)
    assert result.survived.all()
    velocity = result.mean_velocity(result.ticks(3.0, 6.0))
    np.testing.assert_allclose(velocity[:, 0], [0.0, 1.0], atol=0.15)


def test_a_policy_is_evaluated_on_a_slope_and_in_grass() -> None:
    policy, speeds = load_policy(POLICY), []
    for effects in ((), (GroundSlope(rise_x_rad=0.14),), (FootDrag(drag_n_s_per_m=20.0, height_m=0.2),)):
        setting = Setting(policy, model=RobotModel(effects), n_threads=1)
        result = record_walks(policy, setting.plant(1), lambda _: np.array([[1.0, 0.0, 0.0]]), 150)
        assert result.survived.all()
        speeds.append(result.velocity[75:, 0, 0].mean())
    assert speeds[1] < speeds[0] - 0.02
    assert speeds[2] < speeds[0] - 0.02


@pytest.mark.slow
def test_a_whole_evaluation_and_its_page() -> None:
    setting = Setting(load_policy(POLICY), n_threads=1)
    contract = setting.policy.contract.model_copy(
        update={"velocity_command_low": (-0.5, -0.5, -0.5), "velocity_command_high": (0.5, 0.5, 0.5)}
    )
    slow = replace(setting.policy, contract=contract)
    told: dict[str, float] = {}
    kept: list[dict[str, Any]] = []
    result = evaluate_setting(
        Setting(slow, n_threads=1), n=3, tell=told.__setitem__, keep=lambda figures: kept.append(dict(figures))
    )
    assert list(told) == ["tracking", "top_speed", "episodes_slow", "pushes", "slippery_patch", "holds"]
    assert list(told.values()) == sorted(told.values())
    assert told["tracking"] == 0.0
    assert told["holds"] < 1.0
    again: list[str] = []
    resumed = evaluate_setting(Setting(slow, n_threads=1), n=3, done=kept[4], tell=lambda name, _: again.append(name))
    assert again == ["holds"]  # what had ended is not run again
    assert resumed == result == kept[-1]
    assert json.loads(json.dumps(result)) == result
    assert result["top_speed"]["sustained_m_s"] == pytest.approx(0.5, abs=0.15)
    assert result["pushes"]["trials"] == 3
    page = evaluation_page(result, "mine.onnx")
    assert f"Policy mine.onnx holds {result['top_speed']['sustained_m_s']:.2f} m/s" in page
    assert "The file says that its policy is called walk." in page
    assert ">Walks</span>" in page  # three episodes show no more
    assert "0 of 3 fell</b>; 0 falls in 60 s of walking</td>" in page
    assert "Speed against command" in page
    assert "told to turn" not in page  # no command of these turns while it walks
    point = {**result["tracking"]["points"][-1], "command": [2.0, 0.0, 1.0], "velocity": [2.0, 0.0, 0.72]}
    result["tracking"]["points"].append(point)
    result["pushes"]["fell"] = [{"why": f"fall {i}"} for i in range(7)]
    page = evaluation_page(result, "mine.onnx")
    assert "commanded to turn at 1 rad/s while walking at 2 m/s</th><td><b>turns at 0.72 rad/s" in page
    assert page.index("fall 4") < page.index("2 more") < page.index("fall 5")
    assert "src=" not in page
    assert len(page) < 1_500_000


@pytest.mark.parametrize(
    ("falls", "robot_s", "told"),
    [
        (0, 3600.0, "0 falls in 3600 s of walking: at most 3 an hour (95 % bound)"),  # −ln 0.05
        (2, 41.8, "2 falls in 42 s of walking"),  # 0.355 and 6.296 events are possible: no rate
        (100, 36000.0, "100 falls in 36000 s of walking: 8.4 to 12 an hour (90 % interval)"),
    ],
)
def test_falls_and_their_rate_by_hand(falls: int, robot_s: float, told: str) -> None:
    assert _how_often({"falls": falls, "robot_s": robot_s}) == told


def test_an_interrupted_evaluation_goes_on_and_takes_no_trials_of_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran: list[str] = []

    def trial(name: str) -> dict[str, Any]:
        ran.append(name)
        if ran == ["first", "second"]:
            raise KeyboardInterrupt
        return {"trials": 3}

    steps = {name: (1.0, lambda name=name: trial(name)) for name in ("first", "second")}
    monkeypatch.setattr(trials, "_trials", lambda *_: steps)
    setting, kept = Setting(load_policy(POLICY)), tmp_path / "out" / "unfinished.json"
    with pytest.raises(KeyboardInterrupt):
        _evaluated(setting, 3, kept)
    for other, n in ((replace(setting, seed=1), 3), (setting, 4)):
        with pytest.raises(BadInputError, match="interrupted evaluation of another"):
            _evaluated(other, n, kept)
    assert _evaluated(setting, 3, kept) == {**trials.about(setting), "first": {"trials": 3}, "second": {"trials": 3}}
    assert ran == ["first", "second", "second"]
    kept.write_text("{")
    with pytest.raises(BadInputError, match="cannot be read"):
        _evaluated(setting, 3, kept)


def test_the_drawn_friction_keeps_that_of_the_models_effects():
    def feet(effects: tuple[Effect, ...]) -> np.ndarray:
        setting = Setting(policy=None, model=RobotModel(effects=effects))
        plant = setting.random_plant(3, np.random.default_rng(5))
        return plant.fields["geom_friction"][:, [plant.model.geom(name).id for name in FOOT_GEOMS], 0]

    plain, icy = feet(()), feet((GroundFriction(joints=("fl", "hr"), scale=0.25),))
    np.testing.assert_array_equal(icy, plain * [0.25, 1.0, 1.0, 0.25])


@pytest.mark.parametrize("device", ["cpu", "warp-cpu"])
def test_pushes_and_patches_reach_robots_on_any_device(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if device != "cpu":
        pytest.importorskip("mujoco_warp")
    speeds: list[np.ndarray] = []

    def disturbed(*args: Any, **settings: Any) -> WalkRecord:
        plant = args[1]
        for tick in range(800):
            settings["disturb"](plant, tick)
        speeds.append(np.linalg.norm(np.asarray(plant.linear_vel_of_body_in_world_m_s), axis=-1))
        return recording()

    monkeypatch.setattr(trials, "walk_at", disturbed)
    monkeypatch.setattr(trials, "record_walks", disturbed)
    setting = Setting(policy=load_policy(POLICY), device=device)
    trials.pushes(setting, n=3)
    np.testing.assert_allclose(speeds[0], 1.0, rtol=1e-6)
    trials.slippery_patch(setting, n=3)
    trials.episodes(setting, n=3, bottom_m_s=0.0, top_m_s=1.0)
    assert len(speeds) == 3
