"""`spot-rl bench all`: it goes on where it was stopped, takes ratios within a repeat, tells what fails."""

from __future__ import annotations

import json
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from proof.bench_all import (
    Claim,
    Ratio,
    RegressionError,
    ScriptError,
    all_claims,
    flat,
    judge_ratio,
    read_claims,
    run_script,
    spread,
    summary,
    table,
)
from spot_model.errors import BadInputError

REPOSITORY = Path(__file__).parents[2]
COUNTING = """\
import json, pathlib
log = pathlib.Path("log.txt")
n = len(log.read_text()) if log.exists() else 0
log.write_text("x" * (n + 1))
print(json.dumps({"ours": {"us": 10.0 + n}, "peer": {"us": 40.0 + 4.0 * n}, "name": "text"}))
"""

LIST = """\
count: {script: count.py, expected_s: 1, ratios: {times: {over: peer.us, under: ours.us, asked: '>= 5'}}}
other: {script: count.py --again, expected_s: 1, repeats: 1, ratios: {us: {over: ours.us, asked: '<= 100'}}}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "lab" / "benchmarks").mkdir(parents=True)
    (tmp_path / "lab" / "benchmarks" / "count.py").write_text(COUNTING)
    (tmp_path / "lab" / "benchmarks" / "broken.py").write_text("raise SystemExit('no robot today')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SPOT_RL_REVISION", "r1")
    (tmp_path / "lab" / "benchmarks" / "claims.yaml").write_text(LIST)
    return tmp_path


def run(capsys: pytest.CaptureFixture[str], **given: Any) -> dict[str, Any]:
    options: dict[str, Any] = {
        "out": Path("parts.jsonl"),
        "as_json": True,
        "only": None,
        "repeats": 0,
        "guard": False,
        **given,
    }
    all_claims(**options)
    result: dict[str, Any] = json.loads(capsys.readouterr().out)
    return result


def test_repeats_are_interleaved_and_each_ratio_is_of_one_repeat(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = run(capsys)
    order = [json.loads(line)["claim"] for line in (folder / "parts.jsonl").read_text().splitlines()[1:]]
    assert order == ["count", "other", "count", "count"]
    count = told["claims"]["count"]
    assert count["repeats"] == 3
    assert count["figures"]["ours.us"] == {"median": 12.0, "low": 10.0, "high": 13.0}
    assert "name" not in count["figures"]
    assert count["figures"]["script_took_s"]["low"] >= 0.0
    assert count["ratios"]["times"] == {"median": 4.0, "low": 4.0, "high": 4.0, "asked": ">= 5", "holds": False}
    assert told["claims"]["other"]["ratios"]["us"]["holds"] is True
    assert told["revision"] == "r1"


def test_what_was_measured_before_an_interruption_is_kept(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(capsys, repeats=1)
    before = (folder / "parts.jsonl").read_text()
    run(capsys)
    assert (folder / "parts.jsonl").read_text().startswith(before)
    assert len((folder / "log.txt").read_text()) == 4
    run(capsys)
    assert len((folder / "log.txt").read_text()) == 4


def test_parts_of_another_revision_are_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run(capsys, repeats=1)
    monkeypatch.setenv("SPOT_RL_REVISION", "r2")
    with pytest.raises(BadInputError, match="give another --out"):
        run(capsys)


def test_a_file_of_something_else_is_refused_and_kept(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("notes.txt").write_text("my notes\n")
    with pytest.raises(BadInputError, match="holds no results"):
        run(capsys, out=Path("notes.txt"))
    assert Path("notes.txt").read_text() == "my notes\n"


def test_a_script_that_fails_is_told_with_its_last_words(folder: Path) -> None:
    with pytest.raises(ScriptError, match=r"(?s)broken\.py ended with exit code 1.*no robot today"):
        run_script("broken.py")


def test_a_script_finds_the_module_beside_it_also_where_ours_are_kept_from_that(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "lab" / "benchmarks" / "peer.py").write_text("US = 3")
    (folder / "lab" / "benchmarks" / "with_peer.py").write_text("import json, peer\nprint(json.dumps({'us': peer.US}))")
    monkeypatch.setenv("PYTHONSAFEPATH", "1")  # as `spot-rl` sets it for what it starts
    assert run_script("with_peer.py") == {"us": 3}


def test_a_regression_fails_and_unguarded_claims_are_left_out(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    listed = folder / "lab" / "benchmarks" / "claims.yaml"
    listed.write_text(LIST.replace("asked: '>= 5'", "asked: '>= 5', guard: '>= 3'"))
    told = run(capsys, guard=True)
    assert list(told["claims"]) == ["count"]
    assert told["claims"]["count"]["ratios"]["times"]["is_guard_kept"] is True
    listed.write_text(LIST.replace("asked: '>= 5'", "guard: '>= 4.5'"))
    with pytest.raises(RegressionError, match=r"count: times is 4, guarded at >= 4\.5"):
        run(capsys, guard=True)
    with pytest.raises(BadInputError, match="none of these claims has a guard"):
        run(capsys, guard=True, only=["other"])
    capsys.readouterr()
    run(capsys)  # measuring alone fails for no ratio


def test_a_script_that_fails_costs_no_other_its_result_and_is_tried_again(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = "bad: {script: broken.py, expected_s: 1, repeats: 1, ratios: {us: {over: us}}}\n"
    (folder / "lab" / "benchmarks" / "claims.yaml").write_text(LIST + bad)
    with pytest.raises(ScriptError, match="bad: a script failed"):
        run(capsys)
    told = json.loads(capsys.readouterr().out)
    assert told["claims"]["count"]["repeats"] == 3
    assert told["claims"]["bad"]["repeats"] == 0
    assert "no robot today" in told["failed"]["bad"]
    (folder / "lab" / "benchmarks" / "broken.py").write_text("print('{\"us\": 2}')")
    assert run(capsys)["claims"]["bad"]["ratios"]["us"]["median"] == 2.0


def test_a_claim_that_does_not_exist_and_a_folder_without_sources_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(BadInputError, match="there is no claim 'gpu'; there are 'count', 'other'"):
        run(capsys, only=["gpu"])
    (folder / "lab" / "benchmarks").rename(folder / "elsewhere")
    with pytest.raises(BadInputError, match="in the folder of the project's sources"):
        run(capsys)


def test_median_and_spread_by_hand() -> None:
    assert spread([3.0, 1.0, 10.0]) == {"median": 3.0, "low": 1.0, "high": 10.0}
    # Ratios of medians would be 6 / 2 = 3; within the repeats they are 6, 2 and 10.
    repeats = [{"a": 6.0, "b": 1.0}, {"a": 4.0, "b": 2.0}, {"a": 30.0, "b": 3.0}]
    assert judge_ratio(Ratio("a", "b"), repeats)["median"] == 6.0


def test_every_claim_names_a_script_that_is_there_and_the_whole_takes_under_25_minutes() -> None:
    claims = read_claims(REPOSITORY / "lab" / "benchmarks")
    for name, claim in claims.items():
        first = claim.script.split()[0]
        assert first == "spot-rl" or (REPOSITORY / "lab" / "benchmarks" / first).is_file(), name
    assert sum(claim.expected_s * claim.repeats for claim in claims.values()) < 25 * 60


@pytest.mark.parametrize(("claim", "shorter"), [("log", "--seconds 0.1"), ("size", "")], ids=["log", "size"])
def test_a_script_prints_the_figures_that_its_claim_names(
    claim: str, shorter: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(REPOSITORY)
    wanted = read_claims()[claim]
    told = flat(run_script(f"{wanted.script} {shorter}"))
    for label, ratio in wanted.ratios.items():
        assert told[ratio.over] > 0.0, label
        assert told[ratio.under or ratio.over] > 0.0, label


def test_figures_of_a_loop_by_hand() -> None:
    claims = str(REPOSITORY / "lab" / "benchmarks" / "claims")
    loop = runpy.run_path(f"{claims}/loop.py")
    n = loop["SETTLED"]
    ms = 1e6
    # Periods of 21, 18, unknown, unknown, 41 ms: a receipt that no state has echoed is no slip.
    receipts = np.array([0.0, 21.0, 39.0, np.nan, 81.0, 122.0]) * ms
    ticks = np.stack([receipts - 2.0 * ms, receipts], axis=1)
    told = loop["figures"](np.concatenate([np.full((n, 2), np.nan), ticks]), [1.0] * n + [1e-4, 3e-4, 2e-4])
    assert told["slipped"] == 1
    assert told["period_error_mean_ms"] == pytest.approx((1 + 2 + 21) / 3)
    assert told["rate_hz"] == pytest.approx(1e3 / np.mean([21, 18, 41]), rel=1e-3)
    assert told["state_to_command_ms_p50"] == pytest.approx(2.0)
    assert told["compute_us_p50"] == pytest.approx(200.0)
    assert loop["figures"](np.concatenate([np.full((n, 2), np.nan), ticks]), [], 5)["slipped"] == 5


def test_the_table_says_what_does_not_hold() -> None:
    claim = Claim("x.py", 1.0, {"times": Ratio("a", "b", ">= 4")})
    told = table(summary({"one": claim}, {("one", 0): {"a": 6.0, "b": 2.0}}))
    assert "times" in told
    assert "3 (3 to 3)  asked >= 4: NO" in told
