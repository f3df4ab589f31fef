"""The card of a policy: written from an evaluation, printed beside the contract, bound to its file."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from spot_model.console.command_line import main
from spot_model.policy.policy import load_policy

REPOSITORY = Path(__file__).resolve().parents[2]
FIGURES = {
    "schema": "spot-rl/evaluation/1",
    "top_speed": {"sustained_m_s": 1.534, "stride_hz": 2.02, "flight_share": 0.061},
    "tracking": {"mean_forward_error_m_s": 0.0114, "mean_yaw_error_rad_s": 0.0523},
    "episodes_slow": {"falls": 3, "episodes": 100},
    "pushes": {"survived": 99, "trials": 100},
    "holds": {
        "conditions": [
            {"group": "slope", "name": "5° up", "robots": 100, "held": 98},
            {"group": "slope", "name": "10° up", "robots": 100, "held": 71},
            {"group": "payload", "name": "10 kg", "robots": 100, "held": 96},
        ]
    },
}


@pytest.fixture
def policy(tmp_path: Path) -> Path:
    return Path(shutil.copy(REPOSITORY / "policies" / "walk.onnx", tmp_path / "walk.onnx"))


def run(*words: str) -> int:
    with pytest.raises(SystemExit) as left:
        main(["policy", *words])
    return int(left.value.code or 0)


def evaluation_of(policy: Path, **changes: object) -> str:
    path = policy.with_name("evaluation.json")
    path.write_text(json.dumps({**FIGURES, "policy_sha256": load_policy(policy).sha256, **changes}))
    return str(path)


def test_a_card_is_written_from_an_evaluation_and_shown(policy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["card", str(policy), evaluation_of(policy), "--about", "walks", "--gait", "trot", "--tried-on", "the fake"]
    assert run(*words) == 0
    assert run("show", str(policy)) == 0
    out = capsys.readouterr().out
    told = (
        "walk: walks",
        "1.53 m/s",
        "2.0 strides/s, no foot down 6 % of the time",
        "trot",
        "0.011 m/s on average",
        "0.052 rad/s on",
    )
    for line in (
        *told,
        "3 of 100 randomised episodes",
        "99 of 100 walk on",
        "of 100: 5° up 98; 10° up 71",
        "the fake",
        "kp 60 N·m/rad",
    ):
        assert line in out
    assert run(*words) == 2
    assert "nothing is overwritten" in capsys.readouterr().err


def test_a_policy_without_a_card_says_how_to_make_one(policy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("show", str(policy)) == 0
    assert "no card file; 'spot-rl policy card' writes one" in capsys.readouterr().out


def test_a_card_of_another_file_is_not_believed(policy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("card", str(policy), evaluation_of(policy, policy_sha256="0" * 64)) == 2
    assert "evaluate this file" in capsys.readouterr().err
    assert run("card", str(policy), evaluation_of(policy)) == 0
    shutil.copy(REPOSITORY / "policies" / "baseline.onnx", policy)
    assert run("show", str(policy)) == 0
    assert "of another file" in (out := capsys.readouterr().out)
    assert "1.53 m/s" not in out


def test_what_is_no_evaluation_is_refused(policy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for content, told in (("{", "is no JSON"), ("[]", "is no evaluation")):
        (tmp_path / "other.json").write_text(content)
        assert run("card", str(policy), str(tmp_path / "other.json")) == 2
        assert told in capsys.readouterr().err
    policy.with_suffix(".card.yaml").write_text("schema: spot-rl/policy-card/1\npolicy: x\n")
    assert run("show", str(policy)) == 2
    assert "policy card" in capsys.readouterr().err


def test_every_card_that_is_shipped_is_of_its_policy() -> None:
    from spot_model.policy.card import load_card

    for path in sorted((REPOSITORY / "policies").glob("*.onnx")):
        card = load_card(path)
        assert card is None or card.policy_sha256 == load_policy(path).sha256, path.name
