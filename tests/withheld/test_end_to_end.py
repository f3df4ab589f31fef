"""A small case from draw to score, in one command: recorded, diagnosed blind, scored, resumed, packed."""

import json
import tarfile
from pathlib import Path

import pytest
from typer.testing import CliRunner

from spot_model.errors import BadInputError
from withheld.blind.run_folder import load_head
from withheld.command import app
from withheld.outcome import read_outcome
from withheld.scoring.reading import read_cases

pytestmark = pytest.mark.slow

REALITY = "tests.withheld.stand_in:StandIn"
SEED = "5"
WRITES_DOWN = """
import os, sys
if sys.flags.safe_path:
    def note(event, arguments, file=os.open(os.environ["OPENED"], os.O_WRONLY | os.O_CREAT | os.O_APPEND)):
        if event == "open":
            os.write(file, f"{os.path.realpath(arguments[0])}\\n".encode())
    sys.addaudithook(note)
"""
"""Python runs it when it starts; of all processes, only the diagnosing one has a safe path."""


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """File with what the diagnosing process opened, by a hook that is not the judge's."""
    return tmp_path_factory.mktemp("opened") / "paths.txt"


@pytest.fixture(scope="module")
def run(opened: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("withheld") / "run"
    (opened.parent / "sitecustomize.py").write_text(WRITES_DOWN)
    words = ["run", "--out", str(out), "--cases", "9", "--only", "1:2", "--seed", SEED, "--reality", REALITY]
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(opened.parent))
        patch.setenv("OPENED", str(opened))
        done = CliRunner().invoke(app, [*words, "--quick", "--workers", "1", "--keep-logs"])
    assert done.exit_code == 0, (done.output, done.exception)
    return out


def test_each_case_has_a_verdict_a_truth_and_the_size_of_its_faults(run: Path) -> None:
    outcomes = read_cases([run]).outcomes
    assert [o.case.number for o in outcomes] == [1]
    for o in outcomes:
        assert o.verdict is not None, o.problem
        assert len(o.moved) == len(o.consequences) == len(o.truth.faults)
        assert 0.5 <= o.truth.error_scale <= 5.0


def test_the_diagnosis_opens_its_logs_and_nothing_of_the_truth(run: Path, opened: Path) -> None:
    paths = [Path(line) for line in opened.read_text(errors="replace").splitlines()]
    assert len({p for p in paths if p.suffix == ".mcap"}) == len(list((run / "cases/0001/given/logs").iterdir()))
    assert "verdict.json" in {p.name for p in paths}
    assert not [p for p in paths if p.is_relative_to(run)]
    assert not [p for p in paths if {"withheld", "fake_robot"} & set(p.parts) and p.name != "launch.py"]


def test_what_was_given_is_logs_model_and_policy_and_says_nothing(run: Path) -> None:
    outcome = read_outcome(run / "cases" / "0001" / "outcome.json")
    given = run / "cases" / "0001" / "given"
    names = {str(p.relative_to(given)) for p in given.rglob("*") if p.is_file()}
    logs = {n for n in names if n.startswith("logs/")}
    has_policy = {"policy.onnx"} if outcome.case.detail == "stream" else set()
    assert names - logs == {"model.yaml"} | has_policy
    assert len(logs) == outcome.case.repeats * len(outcome.case.sequences)


def test_a_finished_part_is_resumed_at_once_and_gives_the_same_scores(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Sources that are edited while the tests run are none of this test's business.
    head = load_head(run)
    monkeypatch.setattr("withheld.blind.run_folder.digest_of", lambda _: head.digest)
    before = (run / "scores.json").read_text()
    done = CliRunner().invoke(app, ["run", "--out", str(run), "--resume"])
    assert done.exit_code == 0, done.exception
    assert (run / "scores.json").read_text() == before
    assert len(list((run / "cases").iterdir())) == 1


def test_the_packed_run_scores_the_same(run: Path, tmp_path: Path) -> None:
    file = tmp_path / "run.tar.gz"
    assert CliRunner().invoke(app, ["pack", str(run), str(file)]).output.startswith("1 case")
    with tarfile.open(file) as archive:
        archive.extractall(tmp_path / "again", filter="data")
    assert CliRunner().invoke(app, ["score", str(tmp_path / "again")]).exit_code == 0
    assert (tmp_path / "again" / "scores.json").read_text() == (run / "scores.json").read_text()


def test_the_table_is_markdown_without_empty_rows(run: Path) -> None:
    text = CliRunner().invoke(app, ["table", str(run)]).output
    assert "| figure | asked | measured (cases; 95 % interval) | |" in text
    assert "ended without a verdict | " in text
    assert "no case" not in text


def test_a_table_shows_another_run_beside(run: Path) -> None:
    text = CliRunner().invoke(app, ["table", str(run), "--beside", str(run / "scores.json")]).output
    line = next(line for line in text.splitlines() if line.startswith("| ended without a verdict"))
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells[4] == cells[2] != ""
    missing = CliRunner().invoke(app, ["table", str(run), "--beside", str(run / "none.json")])
    assert isinstance(missing.exception, BadInputError)


def test_a_case_is_shown(run: Path) -> None:
    done = CliRunner().invoke(app, ["case", "open", f"{run}/1"])
    assert done.exit_code == 0, done.exception
    status = json.loads((run / "cases" / "0001" / "verdict.json").read_text())["status"]
    assert status in done.output


def test_changed_sources_end_a_run(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("withheld.blind.run_folder.digest_of", lambda _: "another")
    done = CliRunner().invoke(app, ["run", "--out", str(run), "--resume"])
    assert isinstance(done.exception, BadInputError)
    assert "start anew" in str(done.exception)
