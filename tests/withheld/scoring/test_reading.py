"""What may be scored together, and how a run and one of its cases are shown."""

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from spot_model.errors import BadInputError
from withheld.blind.run_folder import RunHead, begin, go_on, load_head, make_folder
from withheld.command import app
from withheld.outcome import Outcome
from withheld.scoring.reading import read_cases, show_case
from withheld.scoring.report import lines, scores, write_scores

from .made_up import fault, outcome, said


def head(**changes: Any) -> RunHead:
    same = {"revision": "r", "digest": "d", "seed": 5, "is_seed_drawn": True, "reality": "judging", "cases": 9}
    return RunHead(part=(0, 9), **(same | changes))


def put(out: Path, o: Outcome) -> Path:
    """A case as a run leaves it."""
    folder = out / "cases" / f"{o.case.number:04d}"
    folder.mkdir(parents=True)
    (folder / "verdict.json").write_text("{}")
    (folder / "outcome.json").write_text(o.model_dump_json(by_alias=True))
    return folder


@pytest.fixture
def run(tmp_path: Path) -> Path:
    out = tmp_path / "run"
    make_folder(out, head())
    put(out, outcome([fault("coulomb_friction")], [said("coulomb_friction")], number=0, moved=(4.0,), true_s=0.9))
    put(out, outcome((), number=1, kind="faultless"))
    return out


def test_a_whole_run_is_read(run: Path) -> None:
    cases = read_cases([run])
    assert [o.case.number for o in cases.outcomes] == [0, 1]
    assert cases.head.seed == 5


@pytest.mark.parametrize("revision", ["abc", "abc+changes"])
def test_a_run_says_of_which_revision_it_is_and_whence_its_seed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, revision: str
) -> None:
    monkeypatch.setenv("SPOT_RL_REVISION", revision)
    seeds = set()
    for name, seed in (("one", None), ("two", None), ("again", 5)):
        policies, more = Path("policies"), {"reality": "judging", "cases": 9, "part": (0, 9), "is_quick": False}
        begin(tmp_path / name, seed, policies, **more)  # type: ignore[arg-type]
        found = load_head(tmp_path / name)
        assert (found.revision, found.is_seed_drawn) == (revision, seed is None)
        seeds.add(found.seed)
    assert len(seeds) == 3
    assert 5 in seeds


def test_a_part_goes_on_as_that_part(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("withheld.blind.run_folder.digest_of", lambda _: "d")
    part = tmp_path / "part"
    make_folder(part, head().model_copy(update={"part": (2, 5)}))
    nowhere = tmp_path / "no policies"
    assert go_on(part, nowhere, None).part == (2, 5)
    assert go_on(part, nowhere, (5, 7)).part == (5, 7)
    assert go_on(part, nowhere, None).part == (5, 7)
    with pytest.raises(BadInputError, match="ends beyond"):
        go_on(part, nowhere, (5, 70))


def test_parts_are_merged(run: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    make_folder(other, head(is_seed_drawn=False))
    put(other, outcome((), number=7, kind="faultless"))
    cases = read_cases([other, run])
    assert [o.case.number for o in cases.outcomes] == [0, 1, 7]
    assert cases.head.is_seed_drawn
    put(other, outcome((), number=1, kind="faultless"))
    with pytest.raises(BadInputError, match="case 1 is in"):
        read_cases([run, other])


@pytest.mark.parametrize(("name", "value"), [("digest", "another"), ("seed", 6), ("reality", "calibrating")])
def test_different_runs_do_not_mix(run: Path, tmp_path: Path, name: str, value: object) -> None:
    other = tmp_path / "other"
    make_folder(other, head(**{name: value}))
    put(other, outcome((), number=7, kind="faultless"))
    with pytest.raises(BadInputError, match=f"differ in {name}"):
        read_cases([run, other])


def test_a_folder_with_a_run_is_not_overwritten(run: Path) -> None:
    with pytest.raises(BadInputError, match="--resume"):
        make_folder(run, head())


def test_an_empty_folder_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="spot-rl withheld run"):
        read_cases([tmp_path])


def test_the_same_outcomes_give_the_same_scores(run: Path) -> None:
    first, second = (json.dumps(scores(read_cases([run]))) for _ in range(2))
    assert first == second


def test_the_page_opens_by_itself_and_begins_with_what_was_judged(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(run.parent)
    (run / "cases" / "0000" / "report.html").write_text("<p>report</p>")
    text = "\n".join(write_scores([run], run))
    assert "1/1" in text
    assert "no case" not in text
    page = (run / "scores.html").read_text()
    assert "2 of 9 cases are judged" in page
    assert "no case" not in page
    assert "cases/0000/report.html" in page
    assert page.count("<script") == 1  # the tooltips
    assert "http" not in page
    data = json.loads((run / "scores.json").read_text())
    assert lines(data)[0].startswith("2 of 9 cases")
    assert any("NOT SHOWN" in line for line in lines(data))


def test_one_case_is_shown(run: Path) -> None:
    for name in (run / "0", run / "cases" / "0000", run / "cases" / "0000" / "outcome.json"):
        text = "\n".join(show_case(name))
        assert "coulomb_friction" in text
        assert "right" in text
    with pytest.raises(BadInputError, match="is no case"):
        show_case(run / "5")


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["run", "--out", "x", "--seed", "1", "--reality", "none"], "module:Class"),
        (["run", "--out", "x", "--resume"], "holds no run"),
        (["score", "x"], "holds no run"),
    ],
)
def test_wrong_words_are_told(words: list[str], text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, words)
    assert done.exit_code != 0
    assert text in str(done.exception)
