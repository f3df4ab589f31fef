"""Scenario files: what they may say, and what a bad one is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from fake_robot.body.body import Body
from fake_robot.robot.robot import Robot
from fake_robot.scenario.parts import TerrainConfig
from fake_robot.scenario.scenario import Scenario, load_scenario, scenario_from_data, shipped_names
from spot_model.errors import BadInputError


def test_an_empty_file_is_the_default_robot(tmp_path: Path):
    path = tmp_path / "empty.yaml"
    path.write_text("")
    assert load_scenario(path) == Scenario()
    assert load_scenario("default").to_data() == Scenario(description="A healthy robot on flat ground.").to_data()


@pytest.mark.parametrize("name", shipped_names())
def test_shipped_scenarios_load_and_survive_a_round_trip(name: str, tmp_path: Path):
    scenario = load_scenario(name)
    path = tmp_path / "copy.yaml"
    path.write_text(yaml.safe_dump(scenario.to_data()))
    assert load_scenario(path) == scenario


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("sed: 3", ["sed = 3", "unknown key", "allowed: schema, description, seed"]),
        ("terrain: {friktion: 0.3}", ["terrain.friktion = 0.3", "allowed: kind, friction"]),
        ("terrain: {friction: -1}", ["terrain.friction = -1", "greater than or equal to 0"]),
        ("terrain: {kind: sand}", ["terrain.kind = 'sand'", "'flat' or 'noise'"]),
        ("seed: '3'", ["seed = '3'", "valid integer"]),
        ("seed: true", ["seed = True", "valid integer"]),
        ("clock: {skew_s: .nan}", ["clock.skew_s = nan"]),
        ("physics: {substeps_per_state: 7}", ["physics", "divide 3 ms", "1, 2, 3, 4"]),
        ("model: {effects: [{effect: warp}]}", ["effects.0", "'warp' is unknown", "coulomb_friction"]),
        (
            "model: {effects: [{effect: coulomb_friction, level_nm: -2}]}",
            ["effects.0", "coulomb_friction.level_nm = -2", "0 to 5 N·m"],
        ),
        ("state_channel: {delay: {kind: constant, delay_s: -1}}", ["state_channel.delay.constant.delay_s = -1"]),
        ("joint_control: {on_command_expiry: explode}", ["on_command_expiry = 'explode'", "'damp'", "'freeze_torque'"]),
        ("schema: spot-rl/scenario/9", ["schema = 'spot-rl/scenario/9'", "spot-rl/scenario/1"]),
        ("battery: {full_voltage_v: 40.0}", ["battery", "above empty_voltage_v = 44 V"]),
        ("[1, 2]", ["a scenario is a mapping of keys, not [1, 2]"]),
        ("a: [", ["is not valid YAML"]),
        ("? {}\n", ["is not valid YAML"]),
    ],
)
def test_a_bad_file_gets_key_value_and_what_is_allowed(tmp_path: Path, text: str, parts: list[str]):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(BadInputError) as caught:
        load_scenario(path)
    message = str(caught.value)
    assert "bad.yaml" in message
    for part in parts:
        assert part in message


def test_a_missing_file_names_the_shipped_ones():
    with pytest.raises(
        BadInputError, match=r"'nowhere' is not a file; allowed: a YAML file, or one of .*default.*slippery"
    ):
        load_scenario("nowhere")


def test_no_yaml_tag_builds_an_object(tmp_path: Path):
    path = tmp_path / "evil.yaml"
    path.write_text("seed: !!python/object/apply:os.getpid []")
    with pytest.raises(BadInputError, match="is not valid YAML"):
        load_scenario(path)


def test_a_delay_may_come_from_a_histogram(tmp_path: Path):
    path = tmp_path / "scenario.yaml"
    path.write_text("state_channel: {delay: {kind: empirical, edges_s: [0.001, 0.002, 0.004], counts: [1, 3]}}")
    delay = load_scenario(path).state_channel.delay
    assert delay.model_dump()["edges_s"] == (0.001, 0.002, 0.004)
    drawn = delay.sample(np.random.default_rng(0), 4000)
    assert 0.001 <= drawn.min() < drawn.max() <= 0.004
    assert np.mean(drawn > 0.002) == pytest.approx(0.75, abs=0.03)


def test_the_fake_steps_otherwise_than_the_plant():
    from spot_model.robot.mjcf_options import MjcfOptions

    physics, plant = Scenario().physics, MjcfOptions()
    assert physics.timestep_s == pytest.approx(0.0015)
    assert physics.timestep_s != plant.timestep_s
    assert physics.integrator != plant.integrator
    assert physics.cone != plant.cone
    assert (physics.contact_time_constant_s, physics.contact_damping_ratio) != plant.contact_solref


def test_payload_and_friction_reach_the_model():
    plain = Robot(Scenario(time_mode="lock_step"))._simulation.body.model
    changed = scenario_from_data(
        {
            "time_mode": "lock_step",
            "payload": {"mass_kg": 8.0, "com_in_body_m": [0.1, 0.0, 0.1]},
            "terrain": {"friction": 0.3},
            "model": {"effects": [{"effect": "coulomb_friction", "joints": ["fl_kn"], "level_nm": 0.7}]},
        }
    )
    model = Robot(changed)._simulation.body.model
    body, foot = model.body("body").id, model.geom("fl_foot").id
    assert model.body_mass[body] == pytest.approx(plain.body_mass[body] + 8.0)
    mass = plain.body_mass[body]
    expected = (mass * plain.body_ipos[body] + 8.0 * np.array([0.1, 0.0, 0.1])) / (mass + 8.0)
    np.testing.assert_allclose(model.body_ipos[body], expected, atol=1e-12)
    # The trace of the inertia about the joint centre of mass: both bodies' own, and each one's distance to it.
    arms = [plain.body_ipos[body] - expected, np.array([0.1, 0.0, 0.1]) - expected]
    trace = plain.body_inertia[body].sum() + 2 * (mass * arms[0] @ arms[0] + 8.0 * arms[1] @ arms[1])
    assert model.body_inertia[body].sum() == pytest.approx(trace)
    assert model.geom_friction[foot, 0] == 0.3
    np.testing.assert_allclose(model.dof_frictionloss[6:], [0, 0, 0.7] + [0] * 9)


def test_a_robot_beyond_the_rough_ground_stands_on_flat_ground():
    """It does not fall off the end of the world: at 1.7 m/s that came after some ten seconds."""
    rough = Scenario(terrain=TerrainConfig(kind="noise", half_size_m=2.0), time_mode="lock_step")
    body = Body(rough, np.random.default_rng(0))
    lain_m = body.height_m()
    body.base_position_m[:2] = (9.0, 0.0)
    for _ in range(2000):
        body.step(None)
    assert body.height_m() == pytest.approx(lain_m, abs=0.02)
    assert not body.has_diverged()
