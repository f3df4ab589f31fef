"""`spot-rl log`: what it prints, what it refuses, how it leaves."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from spot_log import read_run
from spot_log.commands import app
from spot_log.errors import LogReadError


@pytest.fixture
def invoke():
    def call(*arguments):
        return CliRunner().invoke(app, [str(argument) for argument in arguments])

    return call


def test_info_in_words_and_as_json(invoke, synthetic_log):
    words = invoke("info", synthetic_log)
    assert words.exit_code == 0
    assert "ticks     100 at 50.00 Hz" in words.stdout
    assert "time in each mode" not in words.stdout
    everything = invoke("info", synthetic_log, "--all").stdout
    assert everything.startswith(words.stdout)
    assert "time in each mode\n  active: 1.98 s" in everything
    assert "labels: {" in everything
    told = json.loads(invoke("info", synthetic_log, "--json").stdout)
    assert told["commands"]["delay_ms"]["p50"] == pytest.approx(4.0)
    assert told["damage"] == []


def test_info_of_no_log_is_an_error_in_words(invoke, tmp_path):
    (tmp_path / "text.mcap").write_text("hello")
    done = invoke("info", tmp_path / "text.mcap")
    assert isinstance(done.exception, LogReadError)
    missing = invoke("info", tmp_path / "nothing.mcap")
    assert isinstance(missing.exception, LogReadError)
    assert "there is no log" in str(missing.exception)


def test_export_of_a_cut_log_says_so(invoke, synthetic_log, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(synthetic_log.read_bytes()[:50_000])
    done = invoke("export", cut, "--out", tmp_path / "tables", "--format", "csv", "--topics", "state, tick")
    assert done.exit_code == 0
    assert "cannot be read" in done.stderr
    assert sorted(path.name for path in (tmp_path / "tables").iterdir()) == ["header.json", "state.csv", "tick.csv"]


def test_recover_tells_what_is_kept_and_lost(invoke, synthetic_log, tmp_path):
    cut = tmp_path / "run.mcap.active"
    cut.write_bytes(synthetic_log.read_bytes()[:60_000])
    done = invoke("recover", cut, "--out", tmp_path / "new.mcap")
    assert done.exit_code == 0
    run = read_run(tmp_path / "new.mcap")
    assert f"{len(run.states)} of state" in done.stdout
    assert "cannot be read" in done.stdout


def test_report_writes_a_page(invoke, synthetic_log, tmp_path):
    done = invoke("report", synthetic_log, "--out", tmp_path / "run.html")
    assert done.exit_code == 0
    assert (tmp_path / "run.html").stat().st_size > 50_000
