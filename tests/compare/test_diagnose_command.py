"""``spot-rl diagnose`` ends with a log beside both models; what cannot be compared costs no diagnosis."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from compare import diagnose_command
from compare.compare import DATA_NAME, LOG_NAME, PAGE_NAME
from diagnosis import command
from diagnosis.verdict.diagnose import Diagnosis
from spot_model.errors import BadInputError
from spot_model.io.whole import OutputExistsError
from tests.diagnosis import report_case


@pytest.fixture(scope="module")
def a_diagnosis() -> Diagnosis:
    return report_case.a_diagnosis()


@pytest.fixture
def ask(a_diagnosis: Diagnosis, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., Path]:
    """The command with a diagnosis that is there already; gives the folder of the comparison."""

    def run(*, is_in_history: bool = False, **changes: Any) -> Path:
        monkeypatch.setattr(command, "explain_logs", lambda **_: (replace(a_diagnosis, **changes), tmp_path))
        diagnose_command.diagnose(out=None if is_in_history else tmp_path)
        return tmp_path / diagnose_command.FOLDER

    return run


def test_the_robot_stands_beside_the_nominal_and_the_corrected_model(
    ask: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    folder = ask()
    assert capsys.readouterr().out == f"compare    {folder / PAGE_NAME}\n"
    assert (folder / LOG_NAME).stat().st_size > 0
    data = json.loads((folder / DATA_NAME).read_text())
    assert (data["reference"], [r["name"] for r in data["runs"]]) == ("robot", ["nominal model", "corrected model"])
    # The log of sequence a is the one in which the verdict marks a second.
    page = (folder / PAGE_NAME).read_text()
    assert "the load&#x27;s error is large" in page


def test_a_diagnosis_of_a_history_has_it_in_the_folder_of_its_date(ask: Callable[..., Path]) -> None:
    assert (ask(is_in_history=True) / PAGE_NAME).exists()


def test_without_a_corrected_model_the_nominal_one_stays(ask: Callable[..., Path], a_diagnosis: Diagnosis) -> None:
    folder = ask(simulated={"nominal": a_diagnosis.simulated["nominal"], "corrected": ()})
    assert [r["name"] for r in json.loads((folder / DATA_NAME).read_text())["runs"]] == ["nominal model"]


def test_nothing_simulated_is_said_and_nothing_is_written(
    ask: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert not ask(simulated={}).exists()
    assert capsys.readouterr().out == "compare    not written: no log was simulated\n"


def test_a_comparison_that_is_there_stays(ask: Callable[..., Path], tmp_path: Path) -> None:
    (tmp_path / diagnose_command.FOLDER).mkdir()
    with pytest.raises(OutputExistsError, match="exists; nothing is overwritten"):
        ask()


def test_the_options_are_those_of_the_diagnosis() -> None:
    ours, theirs = diagnose_command.diagnose, command.explain_logs
    assert (inspect.signature(ours), ours.__doc__) == (inspect.signature(theirs), theirs.__doc__)


def test_logs_that_are_not_there_are_told_before_anything_is_loaded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(BadInputError, match=r"there is no log .*nowhere; give files written by spot-rl"):
        command.explain_logs([tmp_path / "nowhere"], "ideal", tmp_path / "out")
    assert capsys.readouterr().err == ""
