"""The page: one file that needs nothing from outside, and in a real browser nothing lies on anything else."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from diagnosis.library.registry import LIBRARY
from diagnosis.report import words
from diagnosis.report.output import check_free, write_all
from diagnosis.report.page import _shrink, _which_note, page
from diagnosis.terminal import twelve_lines
from diagnosis.verdict.diagnose import Diagnosis
from spot_log.page.svg import heat, nice_ticks
from spot_model.errors import BadInputError

from .report_case import a_diagnosis, verdict

CHROMIUM = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
)
OVERLAPS = """
<script>
const bad = [];
for (const svg of document.querySelectorAll('svg')) {
  const boxes = [...svg.querySelectorAll('text')].filter(t => t.textContent.trim())
    .map(t => [t.textContent, t.getBoundingClientRect()]);
  const frame = svg.getBoundingClientRect();
  for (const [a, p] of boxes) {
    if (p.left < frame.left - 2 || p.right > frame.right + 2 || p.bottom > frame.bottom + 2)
      bad.push(`${svg.getAttribute('aria-label')}: ${a} is cut`);
    for (const [b, q] of boxes)
      if (a < b && p.left < q.right - 2 && q.left < p.right - 2 && p.top < q.bottom - 4 && q.top < p.bottom - 4 &&
          !svg.getAttribute('aria-label').startsWith('Gap by signal'))
        bad.push(`${svg.getAttribute('aria-label')}: ${a} on ${b}`);
  }
}
if (document.documentElement.scrollWidth > innerWidth) bad.push('the page is wider than the window');
const cell = document.querySelector('[data-t]').getBoundingClientRect();
document.querySelector('[data-t]').dispatchEvent(new MouseEvent('mousemove',
  {bubbles: true, clientX: cell.x + 2, clientY: cell.y + 2}));
document.body.insertAdjacentHTML('beforeend', '<pre id="found"></pre>');
document.getElementById('found').textContent = JSON.stringify(
  {bad, tip: tip.textContent, ink: getComputedStyle(document.body).color, paper:
   getComputedStyle(document.body).backgroundColor});
</script>
"""


@pytest.fixture(scope="module")
def diagnosed() -> Diagnosis:
    return a_diagnosis()


@pytest.fixture(scope="module")
def text(diagnosed: Diagnosis) -> str:
    return page(diagnosed)


class _Links(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [v or "" for k, v in attrs if k in ("src", "href", "srcset", "action", "poster", "data")]


def test_it_asks_for_nothing_from_outside_and_is_small(text: str) -> None:
    links = _Links()
    links.feed(text)
    assert set(links.found) == {"data:,"}
    assert not re.search(r"https?://|@import|url\(|fetch\(|XMLHttpRequest", text)
    assert len(text.encode()) < 2_000_000


def test_everything_is_on_it(text: str) -> None:
    for said in (
        "Partly explained",
        "Dry friction",
        "dry friction",
        "0.71",
        "84 %",
        "rotor inertia",
        "Gap map",
        "Traces",
        "level",
        "2.02",
        "1.91 to 2.13",
        "Record a sprint.",
        "limit of the total power",
        "off: no battery record",
        "spot-rl collect",
        "What no effect explains",
        "depends",
        "A note with &lt;markup&gt; &amp; more.",
    ):
        assert said in text or said.lower() in text, said
    for label in ("Spot, joints coloured", "Probability of each effect", "Gap before and after", "Logs over time"):
        assert label in text


def test_the_floor_is_said_to_be_of_whom_it_is(diagnosed: Diagnosis) -> None:
    told = diagnosed.verdict
    assert told.shrink is not None
    assert "as two runs of the robot are to each other." in page(diagnosed)
    single = told.model_copy(update={"shrink": told.shrink.model_copy(update={"floor_of": "model", "beside": ()})})
    found = _shrink(single)
    assert "as two simulated runs are to each other (the robot repeated no command sequence)." in found
    assert "two runs of the robot" not in found
    assert "floor of simulated runs 1.00" in "\n".join(twelve_lines(single, {}))
    assert "simulated runs" not in "\n".join(twelve_lines(told, {}))


def test_sequences_are_said_to_be_fitted_as_they_were(diagnosed: Diagnosis) -> None:
    told = diagnosed.verdict
    assert told.shrink is not None
    found = page(diagnosed)
    assert "For each command sequence (a, b), the sizes of the effects were fitted to the other ones" in found
    assert "not used for fitting (" not in found
    own = told.model_copy(update={"shrink": told.shrink.model_copy(update={"held_out": ()})})
    assert "The corrected model was fitted to these same logs." in page(replace(diagnosed, verdict=own))


@pytest.mark.parametrize(
    ("rivals", "group", "told", "not_told"),
    [
        ({"coulomb_friction": 0.7}, ("coulomb_friction",), "Red: found. Several", "Grey"),
        ({"coulomb_friction": 0.6, "armature": 0.1}, ("coulomb_friction",), "Red: found. Grey: tried", "Orange"),
        ({"coulomb_friction": 0.6, "armature": 0.1}, ("coulomb_friction", "armature"), "Red: found. Orange", "Grey"),
        ({"coulomb_friction": 0.6, "armature": 0.001}, ("coulomb_friction",), "Red: found. Several", "Grey"),
    ],
)
def test_the_legend_explains_the_bars_that_are_there(
    rivals: dict[str, float], group: tuple[str, ...], told: str, not_told: str
) -> None:
    base = verdict(())
    effect = base.effects[0].model_copy(update={"rivals": rivals, "group": group})
    note = _which_note(base.model_copy(update={"effects": (effect,)}))
    assert told in note
    assert not_told not in note
    assert "need not add up to 1" in note


def test_text_of_a_log_cannot_become_markup(diagnosed: Diagnosis) -> None:
    evil = "<script>alert(1)</script>"
    run = diagnosed.runs[0]
    marked = replace(run, header=replace(run.header, command_sequence=evil))
    told = verdict(diagnosed.map.cells if diagnosed.map else (), nominal=evil, log_advice=(evil,))
    assert evil not in page(replace(diagnosed, runs=(marked,), verdict=told))


def test_the_first_line_says_what_to_do_and_green_needs_probability_and_shrink() -> None:
    """By hand: green from 0.8 and 70 % on, and never with one of the two alone."""
    told = verdict((), status="explained", unknown=None)
    effect, shrink = told.effects[0], told.shrink
    assert shrink is not None
    sure = (effect.model_copy(update={"probability": 0.95, "group": (effect.name,)}),)
    good = told.model_copy(update={"effects": sure})
    assert words.is_green(good)
    assert words.headline(good) == "Train on the corrected model: dry friction at fl_kn explains the gap"
    assert not words.is_green(told)
    assert words.headline(told).startswith("Walk slowly and record it: it is ")
    weak = good.model_copy(update={"shrink": shrink.model_copy(update={"s": 0.5})})
    assert not words.is_green(weak)
    assert words.headline(weak) == "Record more to be sure: it may be dry friction at fl_kn"


@pytest.mark.parametrize("status", ["explained", "unknown_effect", "no_gap", "cannot_tell"])
def test_a_verdict_with_little_in_it_still_makes_a_page(diagnosed: Diagnosis, status: str) -> None:
    bare = verdict((), status=status, effects=(), unknown=None, shrink=None, log_advice=(), invisible=(), timeline=())
    found = page(replace(diagnosed, verdict=bare, map=None, simulated={}))
    assert "Gap map" not in found
    assert "None" not in found


def test_a_robot_without_a_picture_gets_bars() -> None:
    found = page(a_diagnosis(("hip", "knee"), effects=(), unknown=None))
    assert "Gap by joint" in found
    assert "Spot, joints" not in found


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed: the page is not opened in a browser")
@pytest.mark.parametrize("window", ["1400,3000", "800,3000", "420,3000"])
def test_in_a_browser_nothing_overlaps_and_hovering_tells(text: str, tmp_path: Path, window: str) -> None:
    assert CHROMIUM is not None
    file = tmp_path / "page.html"
    file.write_text(text.replace("</body>", OVERLAPS + "</body>"))
    options = ["--headless", "--no-sandbox", "--disable-gpu", f"--window-size={window}", "--dump-dom"]
    home = f"--user-data-dir={tmp_path / 'home'}"
    done = subprocess.run([CHROMIUM, *options, home, file.as_uri()], capture_output=True, text=True, check=True)
    # The page's source holds the element's begin once more, in the script that makes it.
    found = re.findall(r'<pre id="found">(\{.*?)</pre>', done.stdout, re.DOTALL)
    assert found, done.stderr[-500:]
    told = json.loads(found[-1].replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&"))
    assert told["bad"] == []
    assert told["tip"]
    assert told["ink"] != told["paper"]


def test_colours_and_ticks() -> None:
    shades = [sum(int(heat(s)[k : k + 2], 16) for k in (1, 3, 5)) for s in (0.0, 0.25, 0.5, 0.75, 1.0)]
    assert shades == sorted(shades, reverse=True)
    assert heat(2.0) == heat(1.0)
    assert nice_ticks(0.0, 1.0, 5) == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8, 1.0])
    assert nice_ticks(-3.0, 12.0, 4) == pytest.approx([0.0, 5.0, 10.0])


def test_a_diagnosis_is_written_whole_or_not_at_all(
    diagnosed: Diagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"

    def stopped(_: object) -> str:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("diagnosis.report.output.page", stopped)
        with pytest.raises(KeyboardInterrupt):
            write_all(diagnosed, out, LIBRARY)
    assert not out.exists()
    paths = write_all(diagnosed, out, LIBRARY)
    assert sorted(p.name for p in out.iterdir()) == [
        "corrected_model.yaml",
        "experiments",
        "report.html",
        "verdict.json",
    ]
    assert all(p.is_file() for p in paths.values())
    with pytest.raises(BadInputError, match=r"verdict.json exists; nothing is overwritten"):
        check_free(out)
