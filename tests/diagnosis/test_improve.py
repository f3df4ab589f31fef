"""An improvement: its steps, what it compares, and when it takes the new policy."""

from __future__ import annotations

import copy
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from diagnosis.improve import steps
from diagnosis.improve.improvement import worth_training
from diagnosis.improve.judgement import compared_figures, is_taken
from diagnosis.improve.limits import Limit, curve_of, is_nearer, limits_of, search_config, with_limits
from diagnosis.improve.retraining import RETRAIN, refine_config, take_training, train_words
from diagnosis.improve.session import ImproveRequest, improve_policy
from diagnosis.improve.steps import CommandStep, StepError, take
from spot_model.errors import BadInputError, GpuMemoryError
from spot_model.io.model_file import load_model, save_model
from spot_model.io.models_file import load_models, save_models
from spot_model.policy.policy import load_policy
from trainer.config.train_config import load_train_config
from trainer.refine.config import load_refine_config
from trainer.sysid.config import sysid_config_from_data
from trainer.sysid.result import ResultData

from .report_case import verdict

POLICY = Path(__file__).parents[2] / "policies" / "walk.onnx"


def evaluation(**changed: Any) -> dict[str, Any]:
    """Figures of a policy as an evaluation has them; keys of ``changed`` replace whole entries."""
    points = [
        {
            "command": [v, 0.0, 0.0],
            "error": [0.02, 0.01, 0.01],
            "fell": False,
            "power_w": 100.0 * v,
            "gait": "trot",
        }
        for v in (0.5, 1.0, 1.5)
    ]
    data: dict[str, Any] = {
        "tracking": {"points": points, "standing_speed_m_s": 0.01},
        "top_speed": {"sustained_m_s": 4.0, "curve": [[1.0, 1.0, True], [4.0, 4.0, True]]},
        "episodes_slow": {"falls": 1, "episodes": 200},
        "fitted_robot": {"falls": 2, "episodes": 200},
        "possible_robots": {"falls": 3, "episodes": 200},
        "pushes": {"survived": 200, "trials": 200},
        "slippery_patch": {"survived": 200, "trials": 200},
    }
    return {**data, **changed}


def kinds(old: dict[str, Any], new: dict[str, Any]) -> dict[str, str]:
    return {f.name: f.kind for f in compared_figures(old, new)}


def test_the_same_policy_is_neither_better_nor_worse() -> None:
    found = compared_figures(evaluation(), evaluation())
    assert {f.kind for f in found} == {"same"}
    assert not is_taken(found)


def test_a_faster_policy_is_taken_and_one_that_falls_more_is_not() -> None:
    faster = evaluation(top_speed={"sustained_m_s": 4.4, "curve": [[4.0, 4.4, True]]})
    found = compared_figures(evaluation(), faster)
    assert [f.name for f in found if f.kind == "better"] == ["highest speed held"]
    assert is_taken(found)
    falls = {**faster, "possible_robots": {"falls": 20, "episodes": 200}}
    assert kinds(evaluation(), falls)["falls, all robots that the logs allow"] == "worse"
    assert not is_taken(compared_figures(evaluation(), falls))
    # As many falls as chance may bring.
    chance = {**faster, "possible_robots": {"falls": 6, "episodes": 200}}
    assert is_taken(compared_figures(evaluation(), chance))


def test_a_policy_that_hops_or_falls_at_every_speed_is_not_taken() -> None:
    hops = copy.deepcopy(evaluation(top_speed={"sustained_m_s": 5.0, "curve": [[4.0, 5.0, True]]}))
    hops["tracking"]["points"][1]["gait"] = "pronk"
    assert kinds(evaluation(), hops)["gait"] == "worse"
    assert not is_taken(compared_figures(evaluation(), hops))
    falls = evaluation(top_speed={"sustained_m_s": None, "curve": [[4.0, 0.0, False]]})
    assert kinds(evaluation(), falls)["highest speed held"] == "worse"


def test_a_policy_that_no_longer_stands_is_not_taken() -> None:
    walks = copy.deepcopy(evaluation(top_speed={"sustained_m_s": 5.0, "curve": [[4.0, 5.0, True]]}))
    walks["tracking"]["standing_speed_m_s"] = 0.59
    assert kinds(evaluation(), walks)["speed at zero command"] == "worse"
    assert not is_taken(compared_figures(evaluation(), walks))


def test_speed_is_not_bought_with_commands_that_were_followed() -> None:
    slow = copy.deepcopy(evaluation(top_speed={"sustained_m_s": 5.0, "curve": [[4.0, 5.0, True]]}))
    for point in slow["tracking"]["points"]:
        point["error"] = [0.15, 0.01, 0.01]
    assert kinds(evaluation(), slow)["error of forward speed where the old policy follows"] == "worse"
    assert not is_taken(compared_figures(evaluation(), slow))


def test_errors_are_compared_at_commands_that_both_know() -> None:
    wider = copy.deepcopy(evaluation())
    wider["tracking"]["points"].append(
        {**wider["tracking"]["points"][0], "command": [6.0, 0.0, 0.0], "error": [2, 0, 0]}
    )
    assert kinds(evaluation(), wider)["error of forward speed"] == "same"


# Limits ---------------------------------------------------------------------------------------------------------------


def limit(parameter: str, value: float, **kinds: bool) -> Limit:
    nominal = float(getattr(curve_of(load_model("paper_initial")), parameter))
    known = {"is_known": False, "is_reached": False, **kinds}
    return Limit(parameter, "", nominal, value, value - 1.0, value + 1.0, **known)


LIMITS = (
    limit("torque_min_nm", -106.0, is_reached=True),
    limit("speed_min_rad_s", -22.2, is_known=True, is_reached=True),
    limit("speed_max_rad_s", 25.0),
    limit("intersect_max_rad_s", 9.0),
)


def test_robots_have_limits_as_far_as_they_are_known() -> None:
    nominal = load_model("paper_initial")
    fitted, *others = with_limits([nominal] * 200, LIMITS, np.random.default_rng(0))
    assert curve_of(fitted).values["speed_min_rad_s"] == -22.2
    assert curve_of(fitted).values["torque_min_nm"] == -106.0
    drawn = np.array([[curve_of(r).values[p.parameter] for p in LIMITS] for r in others])
    assert np.all(drawn[:, 0] == -106.0)
    assert drawn[:, 1].mean() == pytest.approx(-22.2, abs=0.15)
    assert drawn[:, 1].std() == pytest.approx(1.0 / 1.645, rel=0.2)
    # What no torque reached lies between the nominal number and what the search found, and both corners move together.
    assert drawn[:, 2].min() >= 20.0
    assert drawn[:, 2].max() <= 25.0
    np.testing.assert_allclose((drawn[:, 2] - 20.0) / 5.0, drawn[:, 3] / 9.0)


def test_a_limit_differs_only_if_its_interval_leaves_the_nominal_one_out() -> None:
    assert LIMITS[1].differs
    assert not LIMITS[0].differs
    assert not limit("speed_min_rad_s", -20.5, is_known=True).differs


def test_the_search_for_limits_starts_from_the_corrected_model(tmp_path: Path) -> None:
    save_model(load_model("paper_initial"), tmp_path / "corrected.yaml")
    data = search_config(load_model("paper_initial"), str(tmp_path / "corrected.yaml"), "cpu", 3)
    config = sysid_config_from_data(data, source="test")
    assert [p.parameter for p in config.parameters] == list(curve_of(load_model("paper_initial")).values)
    assert config.space().initial[2] == 20.0
    assert search_config(load_model("ideal"), "ideal", "cpu", 0) is None


def identification(initial: float, identified: float) -> ResultData:
    parameter = {
        "name": "torque_speed_curve[knees].speed_min_rad_s",
        "unit": "rad/s",
        "initial": -20.0,
        "value": -22.2,
        "low": -22.7,
        "high": -21.7,
        "identified": True,
        "source": "measured torque",
        "reason": "",
        "by_search": {"value": -21.0, "low": -40.0, "high": -8.0},
        "by_torque": {"value": -22.2, "low": -22.7, "high": -21.7},
    }
    return ResultData.model_validate(
        {
            "policy_sha256": "",
            "logs": [],
            "confidence": 0.9,
            "parameters": [parameter],
            "measured": [],
            "score": {"initial": initial, "search": 1.0, "identified": identified},
            "score_is_over_floor": False,
            "score_by_generation": [],
            "sequences": [],
            "command_delay_median_s": None,
            "path_delay_median_s": None,
            "observation_noise_sigma": [],
            "load_noise_nm": [],
            "torque_residual_nm": None,
            "time_offset_s": None,
            "warnings": [],
            "config": {},
        }
    )


def test_limits_that_lead_away_from_the_robot_do_not_count() -> None:
    assert is_nearer(identification(2.0, 1.5))
    assert not is_nearer(identification(2.0, 2.5))
    (found,) = limits_of(identification(2.0, 1.5), load_model("paper_initial"))
    assert found.differs


# Steps ----------------------------------------------------------------------------------------------------------------


class Commands:
    """Plays the commands of the steps: notes them, and leaves or fails as told."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.seen: list[tuple[str, ...]] = []
        self.codes: list[int] = []
        self.leaves: dict[str, Any] = {}
        monkeypatch.setattr(steps, "run_command", self.run)

    def run(self, words: Sequence[str]) -> int:
        self.seen.append(tuple(words))
        code = self.codes.pop(0) if self.codes else 0
        if code == 0 and words[0] in self.leaves:
            self.leaves[words[0]](words)
        return code


@pytest.fixture
def commands(monkeypatch: pytest.MonkeyPatch) -> Commands:
    return Commands(monkeypatch)


def ignore(_: str) -> None:
    """Nobody listens."""


def test_a_step_is_taken_once_and_must_leave_its_result(commands: Commands, tmp_path: Path) -> None:
    step = CommandStep("copy", ("copy", "a"), tmp_path / "result")
    with pytest.raises(StepError, match="copy"):
        take(step, ignore)
    commands.leaves["copy"] = lambda _: step.result.touch()
    assert take(step, ignore) is not None
    assert take(step, ignore) is None
    assert commands.seen == [("copy", "a")] * 2
    (tmp_path / "result").unlink()
    commands.codes = [130]
    with pytest.raises(KeyboardInterrupt):
        take(step, ignore)


def test_a_step_without_memory_on_the_gpu_goes_to_the_cores(commands: Commands, tmp_path: Path) -> None:
    step = CommandStep("look", ("look", "--device", "cuda"), tmp_path / "result", on_cores=("look",))
    commands.leaves["look"] = lambda _: step.result.touch()
    commands.codes = [GpuMemoryError.exit_code]
    take(step, ignore)
    assert commands.seen == [("look", "--device", "cuda"), ("look",)]


def test_a_training_without_memory_takes_half_of_the_robots(commands: Commands, tmp_path: Path) -> None:
    run = tmp_path / "training"
    step = CommandStep("training", ("train",), run / "checkpoint_000002.pt")

    def trained(_: Sequence[str]) -> None:
        run.mkdir(exist_ok=True)
        step.result.touch()

    commands.leaves["train"] = trained
    commands.codes = [GpuMemoryError.exit_code, GpuMemoryError.exit_code]
    take_training(step, run, 4096, "cuda", ignore)
    assert [w[1:] for w in commands.seen] == [
        (),
        ("--set", "n_envs=2048"),
        ("--set", "n_envs=2048", "--set", "n_envs=1024"),
    ]
    step.result.unlink()
    commands.codes = [GpuMemoryError.exit_code] * 9
    with pytest.raises(GpuMemoryError):
        take_training(step, run, 4096, "cuda", ignore)


def test_a_training_goes_on_from_its_checkpoint(commands: Commands, tmp_path: Path) -> None:
    run = tmp_path / "training"
    run.mkdir()
    (run / "config.yaml").touch()
    step = CommandStep("training", ("train", "--config", "x"), run / "checkpoint_000002.pt")
    commands.leaves["train"] = lambda _: (run.mkdir(exist_ok=True), step.result.touch())
    # Interrupted before the first checkpoint: nothing to go on from.
    take_training(step, run, 4096, "cuda", ignore)
    assert not (run / "config.yaml").exists()
    step.result.rename(run / "checkpoint_000001.pt")
    take_training(step, run, 4096, "cuda", ignore)
    assert commands.seen[-1] == ("train", "--resume", str(run), "--device", "cuda")


def test_what_is_trained_and_refined_is_valid_and_within_the_policys_range(tmp_path: Path) -> None:
    contract = load_policy(POLICY).contract
    words = train_words(tmp_path / "robots.yaml", POLICY, contract, RETRAIN, ("n_envs=64",), tmp_path / "run", "cuda")
    sets = tuple(words[i + 1] for i, word in enumerate(words) if word == "--set")
    config = load_train_config(RETRAIN, sets)
    assert config.task.commands.v_x_m_s == (contract.velocity_command_low[0], contract.velocity_command_high[0])
    assert (config.n_envs, config.start_from) == (64, str(POLICY))
    path = tmp_path / "refine.yaml"
    path.write_text(yaml.safe_dump(refine_config(Path("paper_identified"), contract, 1)))
    refined = load_refine_config(path)
    assert max(refined.speeds_m_s) == contract.velocity_command_high[0]
    assert len(refined.robots[0].robots()) == 1


# The whole ------------------------------------------------------------------------------------------------------------


class Loop(Commands):
    """Plays a whole improvement in a folder."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, folder: Path, *, has_difference: bool = True) -> None:
        super().__init__(monkeypatch)
        self.out, self.log = folder / "out", folder / "walk.mcap"
        self.log.touch()
        self.new = evaluation(top_speed={"sustained_m_s": 4.4, "curve": [[4.0, 4.4, True]]})
        found = verdict(())
        if not has_difference:
            found = found.model_copy(update={"differences": (), "status": "calibration", "probability_unknown": 0.1})
        model = load_model("paper_initial")

        def diagnosed(_: Sequence[str]) -> None:
            target = self.out / "diagnosis"
            target.mkdir()
            save_model(model, target / "corrected_model.yaml")
            save_models((model, model), target / "possible_robots.yaml")
            (target / "verdict.json").write_text(found.to_json())

        def identified(_: Sequence[str]) -> None:
            (self.out / "identification").mkdir()
            score = (2.0, 1.5) if has_difference else (2.0, 2.5)
            (self.out / "identification" / "result.json").write_text(
                identification(*score).model_dump_json(by_alias=True)
            )

        def trained(words: Sequence[str]) -> None:
            (self.out / "training").mkdir(exist_ok=True)
            (self.out / "training" / f"checkpoint_{load_train_config(RETRAIN).iterations:06d}.pt").touch()

        def exported(_: Sequence[str]) -> None:
            (self.out / "retrained.onnx").write_bytes(POLICY.read_bytes())

        def evaluated(words: Sequence[str]) -> None:
            folder = Path(words[words.index("--out") + 1])
            folder.mkdir()
            data = self.new if folder.name == "evaluation-new" else evaluation()
            (folder / "evaluation.json").write_text(json.dumps(data))

        self.leaves = {
            "diagnose": diagnosed,
            "sysid": identified,
            "train": trained,
            "export": exported,
            "evaluate": evaluated,
        }

    def inputs(self, **changed: Any) -> ImproveRequest:
        given = {
            "policy": POLICY,
            "nominal": "paper_initial",
            "config": None,
            "sets": (),
            "n": 20,
            "seed": 0,
            **changed,
        }
        return ImproveRequest.of([self.log], **given)

    def improve(self, **changed: Any) -> Any:
        return improve_policy(self.inputs(**changed), self.out, workers=1, device="cuda", say=ignore)


def test_an_improvement_from_logs_to_a_policy(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    loop = Loop(monkeypatch, tmp_path)
    result, page = loop.improve()
    assert [words[0] for words in loop.seen] == ["diagnose", "sysid", "train", "export", "evaluate", "evaluate"]
    assert result.outcome == "improved"
    assert result.headline == "In simulation, the new policy is better: highest speed held"
    assert (loop.out / "improved.onnx").read_bytes() == POLICY.read_bytes()
    robots = load_models(str(loop.out / "robots.yaml"))
    assert curve_of(robots[0]).values["speed_min_rad_s"] == -22.2
    text = page.read_text()
    assert "highest speed held" in text
    assert "4.4" in text
    assert "speed min of the knees is -22.2" in text
    # Once more: nothing is run again, and the outcome is the same.
    again, _ = loop.improve()
    assert again.figures == result.figures
    assert len(loop.seen) == 6


def test_an_improvement_goes_on_wherever_it_was_interrupted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    loop = Loop(monkeypatch, tmp_path)
    for done in range(6):
        loop.codes = [0] * (1 if done else 0) + [130]
        with pytest.raises(KeyboardInterrupt):
            loop.improve()
    assert not (loop.out / "improved.onnx").exists()
    result, _ = loop.improve()
    assert result.outcome == "improved"
    assert sum(words[0] == "diagnose" for words in loop.seen) == 2


def test_a_policy_that_is_worse_is_kept_out(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    loop = Loop(monkeypatch, tmp_path)
    loop.new = evaluation(pushes={"survived": 150, "trials": 200})
    result, page = loop.improve()
    assert result.outcome == "kept"
    assert result.headline == "Keep the old policy: the new one is worse: pushes of 1 m/s survived"
    assert not (loop.out / "improved.onnx").exists()
    assert "Keep the old policy" in page.read_text()


def test_a_faultless_robot_is_left_alone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    loop = Loop(monkeypatch, tmp_path, has_difference=False)
    result, page = loop.improve()
    assert result.outcome == "nothing"
    assert [words[0] for words in loop.seen] == ["diagnose", "sysid"]
    assert "The limits that were identified are left out" in page.read_text()
    assert "The logs show no difference to train for: walk stays as it is" in page.read_text()


def test_a_gap_without_a_name_is_no_reason_to_train() -> None:
    found = verdict(()).model_copy(update={"differences": (), "status": "unknown_effect"})
    assert worth_training(found, ()) == "unknown"
    for changed in ({"status": "cannot_tell"}, {"status": "calibration", "probability_unknown": 0.8}):
        assert worth_training(found.model_copy(update=changed), ()) == "unknown"
    quiet = {"status": "calibration", "probability_unknown": 0.1}
    assert worth_training(found.model_copy(update=quiet), ()) == "nothing"
    assert worth_training(found, LIMITS) is None
    sure = verdict(()).differences[0]
    assert worth_training(found.model_copy(update={"differences": (sure,)}), ()) is None
    possible = sure.model_copy(update={"probability": 0.5})
    assert worth_training(found.model_copy(update={"differences": (possible,)}), ()) == "unknown"


def test_wrong_inputs_are_told_before_any_work(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    loop = Loop(monkeypatch, tmp_path)
    with pytest.raises(BadInputError, match=r"no_such\.mcap"):
        ImproveRequest.of([tmp_path / "no_such.mcap"], POLICY, "paper_initial", None, (), 20, 0)
    with pytest.raises(BadInputError, match="no_such_key"):
        loop.inputs(sets=("no_such_key=1",))
    loop.improve()
    with pytest.raises(BadInputError, match=r"another seed \(0\)"):
        loop.improve(seed=1)


def test_a_refinement_that_finds_nothing_keeps_the_old_policy(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    loop = Loop(monkeypatch, tmp_path)

    def refined(_: Sequence[str]) -> None:
        (loop.out / "refinement").mkdir()
        (loop.out / "refinement" / "refinement.json").touch()

    loop.leaves["refine"] = refined
    result, _ = improve_policy(loop.inputs(), loop.out, workers=2, device="cpu", say=ignore)
    assert result.outcome == "kept"
    assert result.headline == "Keep the old policy: the new one is no better"


def test_a_command_runs_in_a_process_of_its_own() -> None:
    assert steps.run_command(("--version",)) == 0
    assert (
        steps.run_command(("improve", "no_such.mcap", "--policy", str(POLICY), "--nominal", "ideal", "--out", "none"))
        == 2
    )
