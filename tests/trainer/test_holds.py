"""Where a policy holds: each robot meets its condition, starts on its ground, and is counted where it gets on."""

from pathlib import Path

import numpy as np
import pytest

from spot_log.page.render import as_html
from spot_model.policy.policy import load_policy
from spot_model.robot import facts
from spot_model.robot.rotation import projected_gravity
from spot_model.robot.terrain import RampTerrain
from trainer.evaluate import holds as trial
from trainer.evaluate.holds import CONDITIONS, COURSE, STAIRS, STEEP, Condition, _commands, _robots, holds
from trainer.evaluate.page import _holds
from trainer.evaluate.setting import FOOT_GEOMS, Setting

POLICY = Path(__file__).parents[2] / "policies" / "walk.onnx"


@pytest.fixture(scope="module")
def setting() -> Setting:
    return Setting(load_policy(POLICY), n_threads=1)


def test_every_condition_is_one_of_its_own() -> None:
    assert len({(c.group, c.name) for c in CONDITIONS}) == len(CONDITIONS)
    assert len(set(CONDITIONS)) == len(CONDITIONS)


def test_robots_start_just_above_their_own_ground_and_carry_what_they_should(setting: Setting) -> None:
    each = [c for c in CONDITIONS for _ in range(2)]
    plant = _robots(setting, each, np.random.default_rng(0))
    assert not plant.foot_contact.any()
    assert not plant.body_contact.any()
    body = plant.model.body("body").id
    mass = np.repeat([c.payload_kg for c in CONDITIONS], 2)
    np.testing.assert_allclose(plant.fields["body_mass"][:, body], facts.BODY.mass_kg + mass)
    foot = plant.model.geom(FOOT_GEOMS[0]).id
    friction = np.repeat([c.friction or setting.mjcf.foot_friction for c in CONDITIONS], 2)
    np.testing.assert_allclose(plant.fields["geom_friction"][:, foot, 0], friction)
    # All soon stand on it, before the pose, which nobody balances, gives way.
    for _ in range(8):
        plant.step(facts.DEFAULT_POSITION_RAD, 4)
    assert plant.foot_contact.any(axis=-1).all()
    assert not plant.body_contact.any()


def test_ramps_are_met_up_and_down_and_walked_straight(setting: Setting) -> None:
    each = [
        Condition("slope", "up", STEEP),
        Condition("slope", "down", STEEP, is_down=True),
        Condition("level", "level"),
    ]
    plant = _robots(setting, each, np.random.default_rng(0))
    # Into the ground, in the body's frame: uphill the nose is up, so gravity pulls backwards.
    forward = projected_gravity(plant.world_from_body_wxyz)[:, 0]
    assert forward[0] < -0.15
    assert forward[1] > 0.15
    assert abs(forward[2]) < 1e-6
    command, _ = _commands(setting, each, np.random.default_rng(0))
    assert not command[:2, 1:].any()
    assert (command[:2, 0] >= 0.3).all()
    assert 0.3 - 1e-6 <= np.hypot(*command[2, :2]) <= 1.0


def test_grounds_of_a_course_do_not_meet() -> None:
    centres = [COURSE.centre_m(i)[1] for i in range(len(COURSE.fields))]
    reach = max(field.half_size_m for field in COURSE.fields)
    assert min(np.diff([0.0, *centres])) > 2.0 * reach


def test_stairs_rise_by_their_steps_within_the_length_that_they_say() -> None:
    heights = RampTerrain(step_m=0.05, tread_m=0.5, half_size_m=2.0).heights_m()
    np.testing.assert_array_equal(heights, heights[:1].repeat(len(heights), axis=0))
    rises = np.diff(heights[0])
    assert sorted(set(np.round(rises, 9))) == [0.0, 0.05]
    assert (rises > 0.0).sum() == 8
    assert heights.shape[1] - 1 == 4.0 / 0.02


def test_who_stays_up_but_does_not_get_on_does_not_hold(setting: Setting, monkeypatch: pytest.MonkeyPatch) -> None:
    some = (CONDITIONS[2], CONDITIONS[8], Condition("steps of 5 cm", "up", STAIRS), CONDITIONS[-1])
    monkeypatch.setattr(trial, "CONDITIONS", some)
    monkeypatch.setattr(trial, "SECONDS", 6.0)
    told = holds(setting, 2)
    assert [c["name"] for c in told["conditions"]] == [c.name for c in some]
    level = told["conditions"][1]
    assert (level["robots"], level["stayed_up"], level["held"]) == (2, 2, 2)
    assert level["progress"] == pytest.approx(0.95, abs=0.1)
    assert holds(setting, 2) == told
    monkeypatch.setattr(trial, "PROGRESS", 1.5)
    assert [c["held"] for c in holds(setting, 2)["conditions"]] == [0, 0, 0, 0]


def test_the_page_colours_by_how_many_hold() -> None:
    def condition(name: str, held: int, progress: float | None) -> dict[str, object]:
        return {"group": "slope", "name": name, "robots": 100, "stayed_up": 99, "held": held, "progress": progress}

    figures = {
        "seconds": 15.0,
        "speed_m_s": [0.3, 1.0],
        "progress_needed": 0.7,
        "conditions": [condition("5° up", 95, 0.87), condition("10° up", 94, None)],
    }
    page = as_html(_holds(figures))
    assert page.index("5° up") < page.index("10° up")
    good, bad = page.split("<i ")[1:]
    assert "95 of 100 · 87 %" in good
    assert "var(--good)" in good
    assert "94 of 100<" in bad
    assert "var(--bad)" in bad
    assert "99 of 100 stayed up, 94 of them kept the speed" in bad
