"""Refinement: what gains do to a network, what a gait costs, and a search that can be cut."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from typer.testing import CliRunner, Result

from spot_model.errors import BadInputError
from spot_model.policy.policy import load_policy, policy_from_bytes
from spot_model.robot import facts
from tests.trainer.conftest import commands
from trainer.ppo.checkpoint_policy import policy_of_layers, read_layers, run_torch
from trainer.ppo.ppo import mirror_action, mirror_observation
from trainer.refine.config import RefineConfig, RefinedRobotConfig, StartConfig, WeightConfig, load_refine_config
from trainer.refine.gains import gains_in, gains_of
from trainer.refine.search import RefineProblem, Steady, judge_gains, run_starts, score_steady, search_gains

POLICY = Path(__file__).parents[2] / "policies" / "walk.onnx"
SMALL = RefineConfig(
    generations=2,
    population=4,
    speeds_m_s=(1.0,),
    others=((0.0, 0.0, 0.0),),
    ramp_s=0.5,
    settle_s=0.0,
    watch_s=1.0,
    starts=(StartConfig(robots=2, top_m_s=1.0, jump_s=0.1),),
)


def observations(n: int = 16) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(1).normal(size=(n, 48)).astype(np.float32))


def test_no_gain_is_the_policy_itself() -> None:
    layers = read_layers(POLICY.read_bytes(), "walk")
    gains = gains_of(facts.JOINT_NAMES)
    assert len(gains) == 40
    assert len({g.name for g in gains}) == 40
    same = gains_in(layers, gains, np.zeros(len(gains)))
    assert torch.equal(run_torch(same, observations()), run_torch(layers, observations()))
    np.testing.assert_allclose(
        run_torch(layers, observations()).numpy(), load_policy(POLICY).act(observations().numpy()), atol=1e-5
    )


def test_gains_act_alike_on_the_left_and_on_the_right() -> None:
    layers, gains = read_layers(POLICY.read_bytes(), "walk"), gains_of(facts.JOINT_NAMES)
    values = np.random.default_rng(2).normal(size=len(gains))

    def mirrored(some: list[tuple[torch.Tensor, torch.Tensor]]) -> torch.Tensor:
        return mirror_action(run_torch(some, mirror_observation(observations())))

    changed = gains_in(layers, gains, values)
    # A network that answers its mirror image with the mirror image keeps doing so: average the network with its image.
    offset = run_torch(changed, observations()) - run_torch(layers, observations())
    assert offset.abs().max() > 0.01
    only_shift = np.where([g.kind == "offset" for g in gains], values, 0.0)
    shifted = gains_in(layers, gains, only_shift)
    left = run_torch(shifted, observations()) - run_torch(layers, observations())
    right = mirrored(shifted) - mirrored(layers)
    torch.testing.assert_close(left, right, atol=1e-5, rtol=1e-5)


def test_a_scaled_feature_is_seen_scaled() -> None:
    layers, gains = read_layers(POLICY.read_bytes(), "walk"), gains_of(facts.JOINT_NAMES)
    index = next(i for i, g in enumerate(gains) if g.name == "joint_velocity_rad_s.hind_kn")
    values = np.zeros(len(gains))
    values[index] = 1.0
    seen = observations()
    seen[:, list(gains[index].columns)] *= 1.0 + gains[index].scale
    assert gains[index].columns == (24 + 8, 24 + 11)
    torch.testing.assert_close(
        run_torch(gains_in(layers, gains, values), observations()), run_torch(layers, seen), atol=1e-5, rtol=1e-5
    )


def test_the_joint_order_is_the_policys() -> None:
    by_type = tuple(f"{leg}_{joint}" for joint in facts.JOINT_TYPES for leg in facts.LEG_NAMES)  # as Isaac Lab's
    gains = {g.name: g for g in gains_of(by_type)}
    names = [by_type[i] for i in gains["offset.hind_hx"].columns]
    assert names == ["hl_hx", "hr_hx"]
    assert gains["offset.hind_hx"].signs == (1.0, -1.0)


def test_what_falls_short_costs() -> None:
    good = Steady(duty_spread=(0.05, 0.06), forward_error_m_s=0.0, other_error=0.0, top_speed_m_s=7.2, falls=0)
    weights = WeightConfig()
    assert score_steady(good, weights) == 0.0
    worse = (
        replace(good, duty_spread=(0.05, 0.1)),
        replace(good, forward_error_m_s=0.1),
        replace(good, other_error=0.1),
        replace(good, top_speed_m_s=6.0),
        replace(good, falls=1),
    )
    assert [round(score_steady(w, weights), 3) for w in worse] == [0.525, 0.5, 0.2, 2.0, 2.0]


def test_a_gait_is_judged_the_same_twice_and_falls_are_seen() -> None:
    policy = load_policy(POLICY)
    first = judge_gains(policy, SMALL, seed=3)
    assert judge_gains(policy, SMALL, seed=3) == first
    assert first.steady[0].falls == 0
    layers, gains = read_layers(POLICY.read_bytes(), "walk"), gains_of(facts.JOINT_NAMES)
    broken = policy_of_layers(gains_in(layers, gains, np.full(len(gains), 8.0)), policy.contract)
    assert judge_gains(broken, SMALL, seed=3).score > first.score + 2.0


def test_a_search_that_was_cut_goes_on_to_the_same_end(tmp_path: Path) -> None:
    problem = RefineProblem(POLICY.read_bytes(), SMALL)
    told: list[int] = []
    whole = search_gains(problem, tmp_path / "whole.jsonl", tell=lambda g: told.append(g.index))
    assert told == [0, 1]
    lines = (tmp_path / "whole.jsonl").read_text().splitlines(keepends=True)
    (tmp_path / "cut.jsonl").write_text("".join(lines[:2]) + lines[2][:40])
    np.testing.assert_array_equal(search_gains(problem, tmp_path / "cut.jsonl"), whole)
    other = RefineProblem(POLICY.read_bytes(), SMALL.model_copy(update={"seed": 1}))
    with pytest.raises(BadInputError, match="belongs to another search"):
        search_gains(other, tmp_path / "whole.jsonl")


def refine(tmp_path: Path, name: str, weights: str) -> tuple[Path, Result]:
    file, out = tmp_path / f"{name}.yaml", tmp_path / f"{name}.onnx"
    file.write_text(
        "{schema: spot-rl/refine/1, generations: 1, population: 6, sigma: 1.0, speeds_m_s: [1.0], others: [],"
        f" starts: [], ramp_s: 0.5, settle_s: 0, watch_s: 1, weights: {{{weights}}}}}"
    )
    words = ["refine", str(POLICY), "--config", str(file), "--out", str(out), "--jobs", "1"]
    return out, CliRunner().invoke(commands(), words)


def test_the_command_leaves_a_better_policy_and_its_figures(tmp_path: Path) -> None:
    out, done = refine(tmp_path, "faster", "top_speed_per_m_s: 10, top_speed_wanted_m_s: 3")
    assert done.exit_code == 0, done.output
    contract = policy_from_bytes(out.read_bytes(), source="refined").contract
    assert contract.training.run.startswith("refined from walk")
    figures = json.loads((tmp_path / "faster.refine" / "refinement.json").read_text())["figures"]
    assert figures["refined"]["top_speed_m_s"][0] > figures["policy"]["top_speed_m_s"][0]

    before = out.read_bytes()
    _, again = refine(tmp_path, "faster", "top_speed_per_m_s: 10, top_speed_wanted_m_s: 3")
    assert "exists; nothing is overwritten" in str(again.exception)
    assert out.read_bytes() == before


def test_a_folder_of_another_search_is_left_as_it_is(tmp_path: Path) -> None:
    folder = tmp_path / "mine.refine"
    folder.mkdir()
    (folder / "generations.jsonl").write_text('{"schema": "another"}\n')
    _, done = refine(tmp_path, "mine", "fall: 1")
    assert "belongs to another search" in str(done.exception)
    assert [f.name for f in folder.iterdir()] == ["generations.jsonl"]
    assert (folder / "generations.jsonl").read_text() == '{"schema": "another"}\n'


def test_what_is_no_better_is_not_written(tmp_path: Path) -> None:
    nothing_counts = "duty_spread: 0, forward_error_per_m_s: 0, other_error: 0, top_speed_per_m_s: 0, fall: 0"
    out, done = refine(tmp_path, "same", nothing_counts)
    assert "nothing was written" in str(done.exception)
    assert not out.exists()


def test_what_a_config_may_say(tmp_path: Path) -> None:
    file = tmp_path / "refine.yaml"
    file.write_text("schema: spot-rl/refine/1\ngenerationz: 3\n")
    with pytest.raises(BadInputError, match="generationz"):
        load_refine_config(file)
    with pytest.raises(ValueError, match="divide"):
        RefinedRobotConfig(timestep_s=0.003)
    with pytest.raises(BadInputError, match="effect"):
        RefinedRobotConfig(effects=({"effect": "no_such"},)).robots()[0]


def test_only_our_own_networks_are_refined() -> None:
    model = onnx.load_from_string(POLICY.read_bytes())
    model.graph.initializer[0].name = "kernel"
    with pytest.raises(BadInputError, match="spot-rl export"):
        read_layers(model.SerializeToString(), "other")


def test_starts_are_on_the_floor_that_is_asked_for() -> None:
    policy, start = load_policy(POLICY), StartConfig(robots=8, top_m_s=1.0, jump_s=0.6)
    ice = start.model_copy(update={"foot_friction": (0.01, 0.01)})
    assert run_starts(policy, RefinedRobotConfig(), ice, 0) > run_starts(policy, RefinedRobotConfig(), start, 0)
