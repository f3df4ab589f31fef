"""Dated diagnoses of one robot: where the next one goes, what it starts from, and what the page says of changes."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from diagnosis.command import diagnose
from diagnosis.document import CalibratedNumber, Calibration, Difference, Number, Verdict, load_verdict
from diagnosis.report import history as filing
from diagnosis.report.drift import Drift, Key, drift_of
from diagnosis.report.history import file_next, read_history
from diagnosis.report.history_page import history_page, write_history
from diagnosis.session import DiagnosisRequest
from spot_log import open_run
from spot_model.effects.base import Effect
from spot_model.effects.drivetrain import Backlash, TorqueGain
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel, save_model

from .planted import Truth, planted_runs, walk_sequence
from .report_case import consequences

DAY_NS = 86_400 * 10**9
KNEE = "fr_kn"


def number(value: float, *, where: str = KNEE, effect: str = "torque_gain", half: float = 0.02) -> CalibratedNumber:
    return CalibratedNumber(
        effect=effect, parameter="gain", title="torque gain", where=where, nominal=1.0, value=value,
        low=value - half, high=value + half, spread=0.06,
    )  # fmt: skip


def backlash(gap_rad: float) -> Difference:
    return Difference(
        name="backlash", title="play in the gear", probability=0.8, group=("backlash",), joints=(KNEE,), split_by="",
        parameters={"gap_rad": Number(value=gap_rad, low=gap_rad - 0.005, high=gap_rad + 0.005, unit="rad")},
    )  # fmt: skip


def put(
    history: Path, name: str, *effects: Effect, gains: tuple[CalibratedNumber, ...] = (number(1.0),), **changes: Any
) -> None:
    """A diagnosis, written by hand."""
    data: dict[str, Any] = {
        "status": "calibration", "where": (), "differences": (), "probability_none": 0.9, "probability_unknown": 0.1,
        "unknown": None, "channels": {}, "shrink": None, "log_advice": (), "headline": f"headline of {name}",
        "calibration": Calibration(units=gains, consequences=consequences()), "robot": "spot-A",
    }  # fmt: skip
    folder = history / name
    folder.mkdir(parents=True)
    (folder / "verdict.json").write_text(Verdict(**(data | changes)).to_json())
    save_model(RobotModel(effects), folder / "corrected_model.yaml")


@pytest.fixture
def history(tmp_path: Path) -> Path:
    put(tmp_path / "robot", "2026-11-05")
    return tmp_path / "robot"


@pytest.fixture
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[Path]]:
    """Logs of a robot on a day of November 2026."""
    (walk,) = planted_runs(Truth(), 1, sequence=walk_sequence(1.0))

    def made(day: int, year: int = 2026) -> list[Path]:
        began_ns = int(filing.datetime(year, 11, day, 15, tzinfo=filing.timezone.utc).timestamp()) * 10**9
        found = {}
        for k in (1, 0):
            header = replace(walk.header, started_host_stamp_ns=began_ns - k * DAY_NS)
            found[tmp_path / f"{k}.mcap"] = replace(walk, header=header)
            (tmp_path / f"{k}.mcap").touch()
        monkeypatch.setattr(filing, "open_run", lambda path: found[path] if path in found else open_run(path))
        return list(found)

    return made


def test_the_next_one_goes_by_the_last_logs_date_and_starts_from_the_model_before(history, logs) -> None:
    place = file_next(history, logs(12), None, None)
    assert place.out == history / "2026-11-12"
    assert place.nominal == str(history / "2026-11-05" / "corrected_model.yaml")
    assert place.since == "2026-11-05"
    given = file_next(history, logs(12), "ideal", None)
    assert (given.nominal, given.since) == ("ideal", "")
    put(history, "2026-11-20")
    named = file_next(history, logs(12), None, history / "2026-11-12-new-knee")
    assert (named.out.name, named.since) == ("2026-11-12-new-knee", "2026-11-05")


def test_what_cannot_be_filed_is_refused_with_the_next_step(history, logs, tmp_path) -> None:
    with pytest.raises(BadInputError, match=r"2026-11-05 exists: .* of that date; .*--out \S*2026-11-05-2"):
        file_next(history, logs(5), None, None)
    with pytest.raises(BadInputError, match=r"no diagnosis before 2026-11-04; give .* --nominal"):
        file_next(history, logs(4), None, None)
    with pytest.raises(BadInputError, match=r"no diagnosis before 2026-11-04; give .* --nominal"):
        file_next(tmp_path / "new", logs(4), None, None)
    place = file_next(history, logs(12), None, None)
    for robot in ("", "spot-A"):
        place.check_robot(robot)
    with pytest.raises(BadInputError, match=r"logs are of robot spot-B; \S*2026-11-05 is of spot-A; .* each robot"):
        place.check_robot("spot-B")
    with pytest.raises(BadInputError, match="holds no log that can be read"):
        file_next(history, [tmp_path / "none.mcap"], None, None)
    with pytest.raises(BadInputError, match=r"tells no date \(it began at 1970-11-12\); name it, as --out"):
        file_next(history, logs(12, year=1970), None, None)
    assert file_next(history, logs(12, year=1970), None, history / "2026-11-12").since == "2026-11-05"
    with pytest.raises(BadInputError, match=r"'week-2' is no date of a history; allowed: .*2026-11-19"):
        file_next(history, logs(12), None, history / "week-2")
    with pytest.raises(BadInputError, match="is not in the history; give"):
        file_next(history, logs(12), None, tmp_path / "2026-11-12")


def test_a_damaged_diagnosis_is_named_before_any_work(history, logs) -> None:
    put(history, "2026-11-06")
    (history / "2026-11-06" / "corrected_model.yaml").unlink()
    with pytest.raises(BadInputError, match=r"2026-11-06 holds no whole diagnosis \(.*corrected_model.*move it away"):
        file_next(history, logs(12), None, None)
    (history / "2026-11-05" / "verdict.json").write_text("{")
    with pytest.raises(BadInputError, match=r"2026-11-05 holds no whole diagnosis \(verdict.json: .*move it away"):
        read_history(history)
    (history / "2026-11-05" / "verdict.json").unlink()
    with pytest.raises(BadInputError, match=r"2026-11-05 holds no whole diagnosis \(.*No such file"):
        read_history(history)
    (history / "2026-11-05").rename(history / "notes")
    (history / "2026-11-06").rename(history / "week 2")
    with pytest.raises(BadInputError, match="'week 2' is no date"):
        read_history(history)


def drift(history: Path) -> Drift:
    return drift_of(read_history(history))


def values(history: Path, key: Key) -> list[float]:
    return [row.numbers[key].value for row in drift(history).rows]


def test_a_number_changed_only_if_the_intervals_say_so(history) -> None:
    steady = tuple(number(1.0, where=f"{leg}_{kind}") for leg in ("fl", "hl", "hr") for kind in ("hx", "hy", "kn"))
    put(history, "2026-11-12", gains=(*steady, number(0.97)), since="2026-11-05")
    assert drift(history).since_last == (
        "No number is shown to have changed since 2026-11-05; 1 of its 1 numbers are measured on both dates.",
    )
    assert drift(history).outcome == "unchanged"
    put(history, "2026-11-19", gains=(*steady, number(0.8)), since="2026-11-12")
    (told,) = drift(history).since_last
    assert drift(history).outcome == "changed"
    assert told.startswith("Changed, beyond what the intervals allow: torque gain of fr_kn 0.97 → 0.8 (0.78 to 0.82)")
    (told,) = drift(history).since_first
    assert "torque gain of fr_kn 1 → 0.8" in told
    (first,) = drift(history).changed
    assert (first, values(history, first)) == (("torque_gain", "gain", KNEE), [1.0, 0.97, 0.8])


def test_a_slow_drift_shows_since_the_first_date_alone(history) -> None:
    for week, gain in enumerate((0.97, 0.94, 0.91, 0.88)):
        put(history, f"2026-12-0{week + 1}", gains=(number(gain),), since="x")
    found = drift(history)
    assert found.since_last[0].startswith("No number is shown to have changed since 2026-12-03;")
    assert "torque gain of fr_kn 1 → 0.88" in found.since_first[0]


def test_a_named_difference_is_told_with_its_size_and_held_afterwards(history) -> None:
    play = Backlash(joints=(KNEE,), gap_rad=0.02)
    put(history, "2026-11-12", play, differences=(backlash(0.02),), status="explained", since="2026-11-05")
    (told,) = drift(history).since_last
    assert told == "Play in the gear at fr_kn, P 0.80: gap of fr_kn 0° → 1.15° (0.859 to 1.43)."
    put(history, "2026-11-19", play, since="2026-11-12")
    wider = (play, Backlash(joints=(KNEE,), gap_rad=0.01))
    put(history, "2026-11-26", *wider, differences=(backlash(0.01),), since="2026-11-19")
    key = ("backlash", "gap_rad", KNEE)
    assert drift(history).changed == (key,)
    assert [(row.numbers[key].value, row.numbers[key].low) for row in drift(history).rows] == [
        (0.0, None), (0.02, 0.015), (0.02, None), (pytest.approx(0.03), pytest.approx(0.025)),
    ]  # fmt: skip
    # A difference against a model of the user's is no change since the date before.
    put(history, "2026-11-27", *wider, differences=(backlash(0.01),), since="")
    assert drift(history).since_last[0].startswith("No number is shown to have changed since 2026-11-26;")


def test_what_the_first_date_names_is_no_change(history) -> None:
    gains = (number(0.8),)
    named = backlash(0.02).model_copy(update={"name": "torque_gain", "parameters": {}})
    put(history, "2026-11-01", gains=gains, differences=(named,), status="explained")
    put(history, "2026-11-12", gains=gains, differences=(named,), status="explained", since="2026-11-05")
    assert drift_of(read_history(history)[:1]).changed == ()
    assert drift(history).changed == (("torque_gain", "gain", KNEE),)


def test_what_nothing_explains_and_what_cannot_be_told_is_said(history) -> None:
    put(history, "2026-11-12", since="2026-11-05", probability_unknown=0.93, status="unknown_effect")
    assert drift(history).outcome == "unknown_effect"
    assert "Something acts that no effect of the library explains (P 0.93)." in drift(history).since_last
    put(history, "2026-11-18", since="2026-11-12", probability_unknown=0.8, status="unknown_effect")
    assert drift(history).since_last[-1].endswith("(P 0.80), as on 2026-11-12.")
    assert drift(history).outcome == "unchanged"
    put(history, "2026-11-19", since="2026-11-18", gains=(), status="cannot_tell")
    assert drift(history).since_last == ("The logs of 2026-11-19 cannot tell.",)


def test_page_and_data_are_derived_and_written_anew(history) -> None:
    (history / "history.html").write_text("old")
    put(history, "2026-11-12", TorqueGain(joints=(KNEE,), gain=0.8), gains=(number(0.8),), since="2026-11-05")
    found, page = write_history(history)
    text = page.read_text()
    assert found.since_last[0].split(" → ")[0] in text
    assert "href='2026-11-12/report.html'" in text
    assert "headline of 2026-11-05" in text
    assert text.count("<svg") >= 1
    told = json.loads((history / "history.json").read_text())
    assert told["since_last"] == list(found.since_last)
    assert [(row["date"], row["numbers"][0]["value"]) for row in told["rows"]] == [
        ("2026-11-05", 1.0), ("2026-11-12", 0.8),
    ]  # fmt: skip
    assert write_history(history)[0] == found


def test_a_page_of_one_date_says_its_headline(history) -> None:
    text = history_page(drift(history))
    assert "headline of 2026-11-05" in text
    assert "changed since" not in text


def test_the_command_files_it_and_tells_what_changed(history, logs, monkeypatch) -> None:
    _, log = logs(12)
    asked: list[DiagnosisRequest] = []

    def at_once(inputs: DiagnosisRequest, out: Path, *_: object, **__: object) -> tuple[object, dict[str, Path]]:
        asked.append(inputs)
        put(out.parent, out.name, gains=(number(0.8),), since=inputs.since)
        return SimpleNamespace(verdict=load_verdict(out / "verdict.json")), {}

    monkeypatch.setattr("diagnosis.session.run_session", at_once)
    told = CliRunner().invoke(diagnose, [str(log), "--history", str(history)])
    assert told.exit_code == 0, told.exception
    assert (asked[0].since, asked[0].nominal) == ("2026-11-05", str(history / "2026-11-05" / "corrected_model.yaml"))
    assert "changed     Changed, beyond what the intervals allow: torque gain of fr_kn 1 → 0.8" in told.output
    assert f"history     {history / 'history.html'}" in told.output
    assert (history / "history.html").exists()
    for words, why in (
        ([], "give --nominal MODEL and --out DIR, or --history DIR"),
        (["--history", str(history)], "2026-11-12 exists"),
        (["--history", str(history), "--robot", str(log)], "--history needs a corrected model"),
    ):
        assert why in str(CliRunner().invoke(diagnose, [str(log), *words]).exception)
