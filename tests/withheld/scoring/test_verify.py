"""What may be scored together, and what was changed after the fact."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from spot_model.errors import BadInputError, SpotRlError
from withheld.blind.run_folder import RunHead, Secret, go_on, load_head, load_secret, make_folder
from withheld.blind.seal import LEDGER, Seal, enter, file_digest
from withheld.command import app
from withheld.outcome import Outcome
from withheld.plan import Truth
from withheld.scoring.report import lines, scores, write_scores
from withheld.scoring.verify import check, show_case

from .made_up import fault, outcome, said

SEED = Secret(seed=5, nonce="00")


def head(**changes: str) -> RunHead:
    same = {"protocol": "p", "generator": "g", "reality": "judging", "seed_digest": SEED.digest}
    return RunHead(policies={}, locked_in="audit hook", cases=9, part=(0, 9), **(same | changes))


def put(out: Path, o: Outcome) -> Path:
    """A case as a run leaves it."""
    folder = out / "cases" / f"{o.case.number:04d}"
    folder.mkdir(parents=True)
    (folder / "verdict.json").write_text("{}")
    seal = Seal.of(o.truth)
    ledger = folder / LEDGER
    enter(ledger, "sealed", case=o.case.number, truth=seal.digest)
    digest = file_digest(folder / "verdict.json")
    enter(ledger, "verdict", case=o.case.number, verdict=digest)
    enter(ledger, "opened", case=o.case.number, truth=seal.digest, nonce=seal.nonce, text=seal.text)
    o = o.model_copy(update={"seal": seal.digest, "verdict_sha256": digest})
    (folder / "outcome.json").write_text(o.model_dump_json(by_alias=True))
    return folder


@pytest.fixture
def run(tmp_path: Path) -> Path:
    out = tmp_path / "run"
    make_folder(out, head(), SEED)
    put(out, outcome([fault("coulomb_friction")], [said("coulomb_friction")], number=0, moved=(4.0,), true_s=0.9))
    put(out, outcome((), number=1, kind="faultless"))
    return out


def test_a_whole_run_is_read(run: Path) -> None:
    checked = check([run])
    assert [o.case.number for o in checked.outcomes] == [0, 1]
    assert checked.seed == 5


def test_a_part_goes_on_as_that_part(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("withheld.blind.run_folder.source_digests", lambda: ("p", "g"))
    part = tmp_path / "part"
    make_folder(part, head().model_copy(update={"part": (2, 5)}), SEED)
    nowhere = tmp_path / "no policies"
    assert go_on(part, nowhere, None)[0].part == (2, 5)
    assert go_on(part, nowhere, (5, 7))[0].part == (5, 7)
    assert go_on(part, nowhere, None)[0].part == (5, 7)
    with pytest.raises(BadInputError, match="ends beyond"):
        go_on(part, nowhere, (5, 70))


def test_parts_are_merged(run: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    make_folder(other, head(), SEED)
    put(other, outcome((), number=7, kind="faultless"))
    assert [o.case.number for o in check([run, other]).outcomes] == [0, 1, 7]
    put(other, outcome((), number=1, kind="faultless"))
    with pytest.raises(BadInputError, match="case 1 is in"):
        check([run, other])


@pytest.mark.parametrize("name", ["protocol", "generator", "reality"])
def test_different_protocols_do_not_mix(run: Path, tmp_path: Path, name: str) -> None:
    other = tmp_path / "other"
    make_folder(other, head(**{name: "another"}), SEED)
    put(other, outcome((), number=7, kind="faultless"))
    with pytest.raises(BadInputError, match=f"differ in {name}"):
        check([run, other])


def test_different_seeds_do_not_mix(run: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    secret = Secret(seed=6, nonce="00")
    make_folder(other, head(seed_digest=secret.digest), secret)
    put(other, outcome((), number=7, kind="faultless"))
    with pytest.raises(BadInputError, match="different seeds"):
        check([run, other])


def test_a_seed_that_was_exchanged_is_refused(run: Path) -> None:
    (run / "seed.json").write_text(Secret(seed=6, nonce="00").model_dump_json())
    with pytest.raises(BadInputError, match="not the one whose digest"):
        load_secret(run, load_head(run))


def test_a_verdict_that_was_changed_is_refused(run: Path) -> None:
    (run / "cases" / "0000" / "verdict.json").write_text("{ }")
    with pytest.raises(SpotRlError, match="before the seal was opened"):
        check([run])


def test_a_truth_that_was_changed_is_refused(run: Path) -> None:
    path = run / "cases" / "0000" / "outcome.json"
    data = json.loads(path.read_text())
    data["truth"] = Truth(faults=()).model_dump()
    path.write_text(json.dumps(data))
    with pytest.raises(SpotRlError, match="not the one that was sealed"):
        check([run])


def test_a_case_that_was_exchanged_is_refused(run: Path) -> None:
    enter(run / LEDGER, "case", case=1, ledger="another", seal="", verdict="")
    with pytest.raises(SpotRlError, match="the run's own ledger entered"):
        check([run])


def test_cases_that_the_seed_does_not_draw_are_refused(run: Path) -> None:
    with pytest.raises(SpotRlError, match="is not the one that seed 5 draws"):
        check([run], Path("policies"))


def test_a_folder_with_a_run_is_not_overwritten(run: Path) -> None:
    with pytest.raises(BadInputError, match="--resume"):
        make_folder(run, head(), SEED)


def test_an_empty_folder_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="spot-rl withheld run"):
        check([tmp_path])


def test_the_same_outcomes_give_the_same_scores(run: Path) -> None:
    first, second = (json.dumps(scores(check([run]))) for _ in range(2))
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
        (["run", "--out", "x"], "one of the two"),
        (["run", "--out", "x", "--seed", "1", "--seed-from-os"], "one of the two"),
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
