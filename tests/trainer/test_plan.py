from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import typer
import yaml
from typer.testing import CliRunner

from spot_model.errors import BadInputError
from spot_model.io.velocity_sequence import save_sequence, sequence_of
from spot_model.policy.built_in import policy_file
from spot_model.policy.policy import Policy, load_policy
from trainer.collect.collect import collect
from trainer.collect.plan import Plan, make_plan, plan_text, standing_start
from trainer.signals.policy_ticks import Script
from trainer.signals.recording import record
from trainer.simulate.recorded_runs import UsualNoise, simulate_scripts
from trainer.sysid.config import SysidConfig
from trainer.sysid.torque_fit import fit_torque
from trainer.sysid.torque_model import TorqueModel, torque_samples

RUN = sequence_of("run", 8.0, (0.0,), (1.0,), (6.0, 4.0, 0.0, 0.0, True))
TURN = sequence_of("turn", 8.0, (0.0,), (1.0, -1.0, 0.5, 0.5), (4.0, 1.0, -0.5, -0.5))


@pytest.fixture(scope="module")
def baseline() -> Policy:
    return load_policy(policy_file("baseline"))


@pytest.fixture(scope="module")
def run_and_turn(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Two sequences as files, with a comma between."""
    files = [tmp_path_factory.mktemp("sequences") / f"{sequence.name}.yaml" for sequence in (RUN, TURN)]
    for sequence, file in zip((RUN, TURN), files, strict=True):
        save_sequence(sequence, file)
    return ",".join(map(str, files))


def expected(**initial: float) -> SysidConfig:
    """The paper's parameters of these names, and the values at which they are expected."""
    known = {p.parameter if p.parameter != "level_nm" else p.joints[0]: p for p in SysidConfig().parameters}
    made = (known[name].model_copy(update={"initial": value}) for name, value in initial.items())
    return SysidConfig(parameters=tuple(made))


@pytest.mark.slow
def test_estimates_from_other_simulated_recordings_spread_as_planned(baseline: Policy, run_and_turn: str) -> None:
    curve = {"torque_max_nm": 70.0, "torque_min_nm": -70.0, "speed_max_rad_s": 20.0, "speed_min_rad_s": -20.0}
    true = expected(hips=0.1, knees=0.2, **curve)
    elsewhere = TorqueModel(
        expected(hips=0.0, knees=0.0, **{name: 1.25 * value for name, value in curve.items()}).space()
    )
    space, start = true.space(), standing_start()
    scripts = [Script(s.name, i, start, s.sampled(50.0)) for i in range(2) for s in (RUN, TURN)]
    found = []
    for seed in range(1, 7):
        rng, model = np.random.default_rng(seed), space.model_with(space.initial)
        samples = torque_samples([record(run) for run in simulate_scripts(model, baseline, scripts, rng, UsualNoise())])
        found.append(fit_torque(elsewhere, samples, [elsewhere.space.initial], rng).values)
    plan = make_plan(baseline, true, run_and_turn, 2)
    for p, spread in zip(plan.parameters, np.std(found, axis=0, ddof=1), strict=True):
        assert p.is_determined, p.reason
        assert p.standard_deviation is not None
        # What legs disagree by is in it, too: it is too large rather than too small.
        assert 0.15 < spread / p.standard_deviation < 1.5, p.name


@pytest.mark.slow
def test_a_knee_that_does_not_move_tells_no_friction_and_a_motion_that_would_is_named() -> None:
    plan = make_plan(load_policy(policy_file("walk")), expected(knees=0.2), "standing", 2)
    (knees,) = plan.parameters
    assert not knees.is_determined
    assert knees.standard_deviation is not None
    assert "forward" in knees.determined_with
    assert all((knees.with_motion[name] or np.inf) < knees.standard_deviation / 3 for name in knees.determined_with)
    advice = plan_text(plan).splitlines()[-1]
    assert advice.startswith("For coulomb_friction[knees].level_nm, add ")
    assert advice.endswith("which determines it.")


@pytest.mark.slow
def test_parameters_that_only_show_together_are_named_as_a_pair(baseline: Policy, run_and_turn: str) -> None:
    config = expected(torque_min_nm=-70.0, speed_min_rad_s=-20.0, intersect_min_rad_s=0.0)
    plan = make_plan(baseline, config, run_and_turn, 1)
    torque, _, corner = plan.parameters
    assert [pair[:2] for pair in plan.confounded] == [(torque.name, corner.name)]
    assert not torque.is_determined
    assert f"{torque.name} and {corner.name} are confounded (correlation " in plan_text(plan)


def test_the_command_says_what_will_be_determined_and_writes_it(run_and_turn: str, tmp_path: Path) -> None:
    config, out, app = tmp_path / "friction.yaml", tmp_path / "out", typer.Typer()
    app.command()(collect)
    data = expected(hips=0.1).model_dump(mode="json", by_alias=True, include={"schema_name", "parameters"})
    config.write_text(yaml.safe_dump(data))
    words = ["--policy", "baseline", "--parameters", str(config), "--out", str(out), "--repeats", "2"]
    words += ["--sequences", run_and_turn]
    result = CliRunner().invoke(app, [*words, "--plan"])
    assert result.exit_code == 0, result.output
    assert "2 runs each of run and turn would determine 1 of 1 parameter." in result.output
    (hips,) = Plan.model_validate_json((out / "plan.json").read_text()).parameters
    assert hips.name == "coulomb_friction[hips].level_nm"
    assert hips.is_determined
    assert 0.0 < (hips.standard_deviation or 0.0) < 0.05
    assert hips.with_motion == {}
    assert "exists; nothing is overwritten" in str(CliRunner().invoke(app, [*words, "--plan"]).exception)
    assert "give --robot HOST to record, or --plan" in str(CliRunner().invoke(app, words).exception)


def test_motions_that_cannot_be_walked_are_refused(baseline: Policy, tmp_path: Path) -> None:
    save_sequence(sequence_of("short", 2.0, (0.0,)), tmp_path / "short.yaml")
    with pytest.raises(BadInputError, match=r"no simulated run can be used:\nshort repeat 1 is left out: it has 100"):
        make_plan(baseline, expected(knees=0.2), str(tmp_path / "short.yaml"), 1)
