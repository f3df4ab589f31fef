"""A prediction: intervals by hand, its file, and which logs may be compared with it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from diagnosis.next.prediction import (
    MOTION,
    Forecast,
    Prediction,
    _forecast,
    check_log,
    check_prediction,
    load_prediction,
)
from diagnosis.next.rounds import Answer
from diagnosis.next.session import Session
from diagnosis.session import Inputs
from diagnosis.verdict.posterior_file import Posterior
from spot_log.format.events import FOLLOWING_MODE
from spot_log.format.records import RunHeader
from spot_log.read.run import Run, run_of_columns
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.io.velocity_sequence import VelocitySequence, save_sequence, sequence_of, standing_sequence
from spot_model.policy.observation import COLUMNS, N_OBSERVATION
from spot_model.policy.policy import load_policy

WALK = Path(__file__).parents[2] / "policies" / "walk.onnx"
LEVEL = np.zeros(N_OBSERVATION)
LEVEL[COLUMNS["projected_gravity_in_body"]] = (0.0, 0.0, -1.0)


def test_an_interval_by_hand() -> None:
    """No log: centre = mean, half = t(0.95, 4) · usual · mean = 2.1318 · 0.04 · 2."""
    made = _forecast(MOTION[0], np.full(5, 2.0), np.zeros(0))
    assert made.value == pytest.approx(2.0)
    assert made.high - made.value == pytest.approx(2.1318 * 0.04 * 2.0, rel=1e-4)


def test_logs_that_are_met_narrow_and_logs_that_are_missed_widen_and_shift() -> None:
    numbers = np.full(5, 2.0)
    none, met, missed = (_forecast(MOTION[0], numbers, np.array(e)) for e in ([], [0.0] * 3, [0.2] * 3))
    assert met.high - met.low < none.high - none.low < missed.high - missed.low
    assert missed.value == pytest.approx(2.0 * (1.0 + 0.6 / 4))


def made_of(sequence: VelocitySequence, **more: Any) -> Prediction:
    top = Forecast(name="top_speed", title="top speed", unit="m/s", value=2.0, low=1.8, high=2.2, measured=2.3)
    given: dict[str, Any] = {
        "policy_sha256": load_policy(WALK).sha256,
        "posterior_sha256": "0" * 64,
        "logs": (("a", 5),),
        "made_host_stamp_ns": 10,
        "forecasts": (top,),
        "fell": 0.0,
        "notes": ("a note",),
    }
    return Prediction(sequence=sequence, **{**given, **more})


def test_a_prediction_comes_back_from_its_file_and_says_whether_it_held(tmp_path: Path) -> None:
    made = made_of(standing_sequence())
    path = tmp_path / "p.json"
    path.write_text(made.to_json())
    assert load_prediction(path) == made
    assert "did not hold" in "\n".join(made.lines())


@pytest.mark.parametrize("text", ["{}", "[1]", "no json", '{"schema": "spot-rl/prediction/1", "sequence": "fast"}'])
def test_what_is_no_prediction_is_told(tmp_path: Path, text: str) -> None:
    (tmp_path / "p.json").write_text(text)
    with pytest.raises(BadInputError, match="no prediction of this release"):
        load_prediction(tmp_path / "p.json")


def ramp(**more: Any) -> VelocitySequence:
    return sequence_of("ramp", 4.0, (0.0,), (1.0,), (3.0, 1.0, 0.0, 0.0, True)).model_copy(update=more)


def run_of(told: VelocitySequence, **header: Any) -> Run:
    """A log of a run under the policy, 50 ticks a second, that began after :func:`made_of`."""
    n = round(told.duration_s * 50)
    given: dict[str, Any] = {"run_id": "b", "started_host_stamp_ns": 20, "policy_sha256": load_policy(WALK).sha256}
    stamps = np.arange(n + 1) * 20_000_000
    return run_of_columns(
        Path("b.mcap"),
        RunHeader(**{**given, "command_sequence": told.name, **header}),
        states={"robot_stamp_ns": stamps},
        commands={"key": np.zeros(0, dtype=np.int64)},
        ticks={
            "robot_stamp_ns": stamps,
            "mode": np.full(n + 1, FOLLOWING_MODE),
            "observation": np.tile(LEVEL, (n + 1, 1)),
            "action": np.zeros((n + 1, 12)),
            "velocity_command": np.array([told.at(i / 50) for i in range(n + 1)]),
        },
    )


def test_a_run_of_the_command_after_the_prediction_is_compared() -> None:
    check_log(made_of(ramp()), run_of(ramp()), load_policy(WALK))
    check_log(made_of(ramp()), run_of(ramp(), policy_sha256=""), load_policy(WALK))  # of another program


@pytest.mark.parametrize(
    ("run", "told"),
    [
        (run_of(ramp(), run_id="a", started_host_stamp_ns=5), "b.mcap was used in the diagnosis"),
        (run_of(ramp(), started_host_stamp_ns=10), "before the prediction was made at 1970-01-01"),
        (run_of(ramp(), policy_sha256="f" * 64, policy_name="other"), "of other with SHA-256 ffffffffffff"),
        (run_of(sequence_of("ramp", 4.0, (0.0,), (2.0, 1.0))), "after 1.12 s it was told 0.00"),
        (run_of(standing_sequence(4.0)), r"\(sequence standing\) is of other commands than ramp"),
        (run_of(ramp(duration_s=3.5)), "has 3.5 s under the policy .*; predicted were 4 s"),
        (run_of(ramp(duration_s=6.0)), "has 6.0 s under the policy"),
        (run_of(standing_sequence(0.01)), "give a whole run"),
    ],
)
def test_a_log_that_says_nothing_of_a_prediction_is_refused(run: Run, told: str) -> None:
    with pytest.raises(BadInputError, match=told):
        check_log(made_of(ramp()), run, load_policy(WALK))


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (made_of(ramp(duration_s=5.0)), "other commands of sequence ramp"),
        (made_of(ramp(), policy_sha256="f" * 64), "the policy with SHA-256 ffffffffffff"),
        (made_of(ramp(), posterior_sha256="1" * 64), "another diagnosis"),
    ],
)
def test_a_prediction_that_is_there_serves_what_it_is_of_alone(made: Prediction, told: str) -> None:
    policy = load_policy(WALK)
    check_prediction(made_of(ramp()), Path("p.json"), ramp(), policy, "0" * 64)
    with pytest.raises(BadInputError, match=rf"p.json holds a prediction of {told}.*give --out FILE"):
        check_prediction(made, Path("p.json"), ramp(), policy, "0" * 64)


SOUND: dict[str, Any] = {
    "schema": "spot-rl/posterior/2",
    "possibilities": [
        {
            "weight": 1.0,
            "distance_floors": None,
            "model": RobotModel().to_data(),
            "terms": [{"effect": "warp", "joints": ["knees"], "shape": {}, "mean": [1.0], "covariance": [[0.0]]}],
        }
    ],
}


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"weight": 0.0}, "the weights of the possibilities add up to 0"),
        ({"terms": [{**SOUND["possibilities"][0]["terms"][0], "covariance": [[1.0, 0.0]]}]}, "of warp is not 1 × 1"),
        (None, "at least 1 item"),
    ],
)
def test_a_posterior_from_which_nothing_can_be_drawn_is_told(change: dict[str, Any] | None, told: str) -> None:
    some = [] if change is None else [{**SOUND["possibilities"][0], **change}]
    with pytest.raises(ValidationError, match=told):
        Posterior.model_validate({**SOUND, "possibilities": some})


def test_an_effect_that_the_library_lacks_is_named() -> None:
    posterior = Posterior.model_validate(SOUND)
    with pytest.raises(BadInputError, match="names warp, which the library of effects does not have; diagnose again"):
        posterior.draw({}, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("told", "file", "error"),
    [
        (ramp(name="../../a"), "prediction__a.json", None),
        (sequence_of("brief", 0.5, (0.0, 0.5)), None, "duration_s is 0.5; allowed: at least 1 s"),
        (sequence_of("fast", 4.0, (0.0, 9.0)), None, "asks for more than policy walk was trained on"),
    ],
)
def test_what_is_asked_for_is_looked_at_before_anything_is_simulated(
    told: VelocitySequence, file: str | None, error: str | None, tmp_path: Path
) -> None:
    save_sequence(told, tmp_path / "asked.yaml")
    found = Answer(tmp_path, Posterior.model_validate(SOUND), "explained", "")
    session = Session(tmp_path, Inputs(logs=(), nominal="ideal"), found, load_policy(WALK), 0)
    with pytest.raises(BadInputError, match=error or rf"/{file} is not there: a run can only be compared"):
        session.predicted(str(tmp_path / "asked.yaml"), None if error else tmp_path / "log.mcap", None)
