from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from spot_log import Run
from spot_model.effects.commands import CommandDelay
from spot_model.effects.friction import Armature
from spot_model.errors import BadInputError
from spot_model.io.model_file import load_model
from spot_model.plant.delay import EmpiricalDelay
from spot_model.policy.policy import load_policy
from trainer.simulate.engine import Place
from trainer.simulate.rollout import RolloutOptions
from trainer.sysid.config import CONTACT_CHOICES_S, SearchConfig, SimulationConfig, SysidConfig
from trainer.sysid.identify import prepare
from trainer.sysid.logs import LogSet
from trainer.sysid.measured import MeasuredDelays, with_measured
from trainer.sysid.result import ResultData
from trainer.sysid.run_identification import identification_summary, run_identification
from trainer.sysid.search import build_problem
from trainer.sysid.verdict import score_intervals

QUICK = SysidConfig(
    search=SearchConfig(generations=2, population=4),
    simulation=SimulationConfig(timestep_s=0.005, contact_time_constant_s=0.0125, final_robots_per_sequence=2),
)


def log_set(runs: list[Run], warnings: tuple[str, ...] = ()) -> LogSet:
    return LogSet(tuple(runs), tuple(runs), warnings)


@pytest.fixture(scope="module")
def out(logs: list[Run], policy_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sysid") / "out"
    run_identification(log_set(logs, ("x.mcap: <left> out",)), policy_path, QUICK, folder, place=Place())
    return folder


def test_the_result_says_what_was_found_and_what_was_not(out: Path) -> None:
    data = ResultData.model_validate_json((out / "result.json").read_text())
    assert [p.name for p in data.parameters] == list(SysidConfig().space().names)
    for parameter in data.parameters:
        assert parameter.low <= parameter.value <= parameter.high or not parameter.identified
        assert parameter.identified == (parameter.source != "not identified")
    assert set(data.score) == {"initial", "search", "identified"}
    assert data.score_is_over_floor
    assert len(data.score_by_generation) == 2
    assert data.path_delay_median_s == pytest.approx(0.005, abs=1e-6)


def test_the_true_limits_bring_the_score_down(out: Path) -> None:
    score = json.loads((out / "result.json").read_text())["score"]
    assert score["identified"] < 0.8 * score["initial"]


def test_the_identified_model_is_one_that_others_load(out: Path) -> None:
    model = load_model(str(out / "identified.yaml"))
    found = {p["name"]: p["value"] for p in json.loads((out / "result.json").read_text())["parameters"]}
    curve = next(e for e in model.effects if e.name == "torque_speed_curve")
    assert curve.values["torque_min_nm"] == pytest.approx(found["torque_speed_curve[knees].torque_min_nm"])
    delay = next(e for e in model.effects if isinstance(e, CommandDelay))
    assert delay.delay_s == pytest.approx(0.005, abs=1e-6)


def test_noise_and_delays_are_files_that_others_read(out: Path) -> None:
    data = yaml.safe_load((out / "noise.yaml").read_text())
    assert set(data) == {"task", "sensors", "command_channel"}
    delay = EmpiricalDelay.model_validate(data["command_channel"]["delay"])
    assert np.median(delay.sample(np.random.default_rng(0), 1000)) > 0.0045


def test_the_page_stands_alone_and_escapes_what_it_shows(out: Path) -> None:
    page = (out / "report.html").read_text()
    assert "Not identified" in page
    assert "x.mcap: &lt;left&gt; out" in page
    assert 'src="http' not in page
    for name in ("best of the generation", "fr_kn action"):
        assert name in page


def test_nothing_is_overwritten(out: Path, logs: list[Run], policy_path: Path, tmp_path: Path) -> None:
    before = {p.name: p.read_bytes() for p in out.iterdir()}
    with pytest.raises(BadInputError, match="exists; nothing is overwritten"):
        run_identification(log_set(logs), policy_path, QUICK, out)
    assert {p.name: p.read_bytes() for p in out.iterdir()} == before
    (tmp_path / "search.jsonl").write_text("")
    with pytest.raises(BadInputError, match="unfinished search; give --resume"):
        run_identification(log_set(logs), policy_path, QUICK, tmp_path)
    with pytest.raises(BadInputError, match="holds no unfinished search; leave --resume out"):
        run_identification(log_set(logs), policy_path, QUICK, tmp_path / "new", resume=True)


def test_without_measured_load_only_distributions_speak(logs: list[Run], policy_path: Path) -> None:
    blind = [replace(r, states=replace(r.states, load_nm=np.full_like(r.states.load_nm, np.nan))) for r in logs]
    preparation = prepare(log_set(blind), load_policy(policy_path), QUICK)
    assert preparation.samples is None
    assert [c.what for c in preparation.changes] == ["command delay"]


def test_the_contact_with_the_best_score_is_taken(logs: list[Run], policy_path: Path) -> None:
    config = QUICK.model_copy(update={"simulation": SimulationConfig(timestep_s=0.005, final_robots_per_sequence=1)})
    preparation = prepare(log_set(logs[:2]), load_policy(policy_path), config)
    change = preparation.changes[-1]
    assert change.what == "contact time constant"
    assert change.value in CONTACT_CHOICES_S
    pairs = [w.removesuffix(" ms").split(" at ") for w in change.source.split(": ")[1].split(", ")]
    scores = {float(time_ms): float(score) for score, time_ms in pairs}
    assert scores[1e3 * change.value] == min(scores.values())


def test_what_is_measured_goes_into_the_model_unless_it_is_searched() -> None:
    space = SysidConfig().space()
    delays = MeasuredDelays(np.full(5, 0.0045), np.full(5, 0.003))
    found, changes = with_measured(space, delays, None, use_delay=True, use_inertia=True)
    assert [e.delay_s for e in found.model.effects if isinstance(e, CommandDelay)] == [0.0045]
    assert not any(isinstance(e, Armature) for e in found.model.effects)
    assert [c.what for c in changes] == ["command delay"]
    kept, none = with_measured(space, delays, None, use_delay=False, use_inertia=False)
    assert kept == space
    assert none == ()


def test_one_run_a_sequence_gives_no_interval_and_no_floor(logs: list[Run], policy_path: Path) -> None:
    single = [logs[0], logs[3]]
    problem = build_problem(
        SysidConfig().space(), policy_path.read_bytes(), single, RolloutOptions(), robots_per_sequence=1, weights={}
    )
    assert [r.floor for r in problem.references] == [None, None]
    assert score_intervals(problem, np.zeros((1, 8)), [], 0.9, np.random.default_rng(0)) is None


def test_the_summary_counts_what_is_identified(out: Path) -> None:
    data = ResultData.model_validate_json((out / "result.json").read_text())
    n = sum(p.identified for p in data.parameters)
    assert identification_summary(data).startswith(
        f"{n} of 8 parameters are identified from 6 logs of 2 command sequences."
    )
