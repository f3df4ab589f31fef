"""The page: one file, no network, every plot in it; and in a real browser, drawn."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from spot_log import read_run
from spot_log.page.draw import thinned
from spot_log.page.figures import FIGURES, torque_limit_nm
from spot_log.page.page import page_html, write_page
from spot_log.page.render import as_html
from spot_model.io.whole import OutputExistsError

CHROMIUM = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
)


@pytest.fixture(scope="module")
def run(synthetic_log):
    return read_run(synthetic_log)


@pytest.fixture(scope="module")
def page(run, tmp_path_factory):
    return write_page(run, tmp_path_factory.mktemp("page") / "run.html")


def test_the_page_is_one_file_with_every_plot(page):
    text = page.read_text(encoding="utf-8")
    for figure in FIGURES.values():
        assert "<svg" in text.split(f"<h2>{figure.heading}</h2>")[1].split("</section>")[0]
    assert len(text.encode()) < 1_500_000
    assert set(re.findall(r"""(?:src|href)\s*=\s*["']([^"']*)""", text)) == {"data:,"}
    assert text.count("<!doctype html>") == 1
    for told in ("synthetic-1", "lab floor", "a set-point was clamped", "sequence forward, repeat 3"):
        assert told in text


def test_text_from_a_log_cannot_become_markup(run):
    evil = "<script>alert(1)</script>"
    header = replace(run.header, run_id=evil, labels={"note": evil})
    event = run.events[0]._replace(text=evil)
    text = page_html(replace(run, header=header, events=(event,)))
    assert evil not in text
    assert "&lt;script&gt;alert(1)" in text


@pytest.mark.parametrize(
    ("text", "badge"),
    [
        ("operator_stop: the operator asked to stop; when ready, 'spot-rl ctl arm' or 'spot-rl run'", "No fault"),
        ("state_stale: the newest state is 61 ms old", "Errors"),
    ],
)
def test_a_stop_that_the_operator_wished_is_no_fault(run, text, badge):
    event = run.events[0]._replace(name="stop", text=text, severity=type(run.events[0].severity).ERROR)
    assert f">{badge}</span>" in page_html(replace(run, events=(event,)))


def test_a_log_without_data_gives_a_page_that_says_so(run):
    names = ("states", "commands", "ticks", "slow_states")
    empty = replace(run, events=(), **{name: getattr(run, name).rows(slice(0)) for name in names})
    assert all(figure.draw(empty) is None for figure in FIGURES.values())
    assert page_html(empty).count("The log has no data for this.") == len(FIGURES)


def test_loads_carry_the_robots_limits(run):
    assert as_html(FIGURES["loads"].draw(run)).count("stroke:var(--bad)") == 24
    np.testing.assert_allclose(torque_limit_nm(run, 0), 45.0)
    knee = torque_limit_nm(run, 2)
    # At −1.5 rad ± 0.2 the knee can give between 105 and 114 N·m.
    assert knee.min() > 105
    assert knee.max() < 114


def test_velocity_shows_command_and_body(run):
    forward = as_html(FIGURES["velocity"].draw(run)).split("</svg>")[0]
    heights = {
        name: {point.split(",")[1] for point in way.split()}
        for way, name in re.findall(r'points="([^"]*)" style="fill:none;stroke:var\(--(floor|group)\)', forward)
    }
    # Steady at 0.8 m/s below the command's 1 m/s.
    assert len(heights["floor"]) == len(heights["group"]) == 1
    assert float(min(heights["floor"])) > float(min(heights["group"]))


def test_contact_bars_cover_the_stance(run):
    chart = FIGURES["contacts"].draw(run)
    whole, stands = chart.lines[:2]
    (first, last), at = whole.x, np.reshape(stands.x, (-1, 3))
    share = float((at[:, 1] - at[:, 0]).sum() / (last - first))
    assert share == pytest.approx(run.states.foot_contact[:, 0].mean(), abs=0.02)


def test_pages_are_never_overwritten(run, page):
    before = page.read_bytes()
    with pytest.raises(OutputExistsError, match="exists; nothing is overwritten: choose another name"):
        write_page(run, page)
    assert page.read_bytes() == before


def test_thinning_keeps_peaks_and_ends():
    rng = np.random.default_rng(5)
    values = rng.normal(size=50_000)
    values[12_345], values[40_001] = 99.0, -99.0
    rows = thinned(values, 500)
    assert len(rows) <= 500
    assert {0, 12_345, 40_001, 49_999} <= set(rows.tolist())
    assert (np.diff(rows) > 0).all()
    assert thinned(values[:400], 500).tolist() == list(range(400))


@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason="no headless Chromium is installed")
def test_a_browser_draws_every_plot(page, tmp_path):
    command = [
        CHROMIUM,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-quic",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        f"--user-data-dir={tmp_path / 'profile'}",
        "--virtual-time-budget=10000",
        "--dump-dom",
        f"file://{page}",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    drawn = done.stdout.split("<h2>")
    for heading in [figure.heading for figure in FIGURES.values()]:
        assert "<svg" in next(part for part in drawn if part.startswith(heading)), heading
    # One line a joint for set-point and position.
    joints = next(part for part in drawn if part.startswith("Joints"))
    assert joints.count("stroke:var(--floor)") >= 12
    assert joints.count("stroke:var(--group)") >= 12
