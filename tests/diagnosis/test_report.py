"""The page: one file that needs nothing from outside, and in a real browser nothing lies on anything else."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from diagnosis.document import Calibration, GapCell, GapChange, Number
from diagnosis.library.registry import LIBRARY
from diagnosis.report import figures, words
from diagnosis.report.headline import headline, is_good, next_step
from diagnosis.report.output import check_no_diagnosis, write_all
from diagnosis.report.page import page
from diagnosis.verdict.diagnose import Diagnosis
from spot_log.page.draw import heat, nice_ticks
from spot_model.errors import BadInputError

from .report_case import a_diagnosis, change, consequences, verdict

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
      if (a < b && p.left < q.right - 2 && q.left < p.right - 2 && p.top < q.bottom - 4 && q.top < p.bottom - 4)
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
FALLS = change("fall_share", "share of runs that fall", "", 0.0, 0.867, low=0.6, high=1.0)


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
        "Cause narrowed down, more is left",
        "<h1>Dry friction or friction near standstill (Stribeck) at fl_kn: 2.02 N·m (1.91 to 2.13) if it",
        "Corrected, 84 % of the torque gap closes. What is left: torque 1 N·m, 2.5 times what repeats or noise",
        "<p class='lead'>Next: walk slowly and record it, to tell",
        "84 % of the torque gap closes (90 % interval: 77 % to 90 %)",
        "The change of the joint motion gap may be chance.",
        "The body motion gap grows.",
        "P 0.00; an effect that the library lacks, P 0.35.",
        "84 % of the torque gap closes (90 % interval: 77 % to 90 %); slower by 0.21 m/s (top speed)",
        "level 2.4 N·m (2.2 to 2.6)",
        "these logs allow <b>friction near standstill (Stribeck) (P 0.20)</b>",
        "Dry friction shows in set-point to load 97 %",
        "4 numbers of the robot&#x27;s own beside the nominal ones; 2 stand out",
        "0.86 (0.85 to 0.87)",
        "P(out of the ordinary)",
        "torque gain: 73 % of the torque gap closes (90 % interval: 60 % to 80 %); slower by 0.21 m/s (top speed)",
        "in load error, in times what two runs of the robot differ by",
        "Gap map",
        "Record a sprint.",
        "limit of the total power",
        "no battery record",
        "spot-rl collect",
        "What no effect explains",
        "Set-point to load at fl_kn, largest in motoring: 1.6 N·m is left; corrected models of faultless robots leave",
        "leave at most 0.8 N·m there (95 in 100): 2.0 times as much.",
        "1.0 to 2.0 s</td><td>the load&#x27;s error is large",
        "The play of fl_kn is fitted as −0.01 rad, and held at 0.",
        "A note with &lt;markup&gt; &amp; more.",
    ):
        assert said in text, said
    for label in ("Spot, joints coloured", "Three gaps, before and after"):
        assert label in text


@pytest.mark.parametrize(
    ("changes", "floor", "measured"),
    [
        ({}, "two runs of the robot", "on command sequences that nothing was fitted to"),
        ({"floor_of": "model"}, "two simulated runs", "on command sequences that nothing was fitted to"),
        (
            {"held_out": ()},
            "two runs of the robot",
            "with the commands to which the corrected one was fitted",
        ),
    ],
)
def test_floor_and_sequences_are_said_to_be_what_they_are(
    diagnosed: Diagnosis, changes: dict[str, object], floor: str, measured: str
) -> None:
    told = diagnosed.verdict
    assert told.shrink is not None
    found = page(replace(diagnosed, verdict=told.model_copy(update={"shrink": told.shrink.model_copy(update=changes)})))
    assert f"</i>{floor}</span>" in found
    assert measured in found
    opened = told.model_copy(update={"consequences": consequences(loop="open", changes=())})
    found = page(replace(diagnosed, verdict=opened))
    assert "</i>what noise and formulas leave</span>" in found
    assert "predicted from each other" in found


def test_numbers_that_do_not_stand_out_are_folded_away(diagnosed: Diagnosis) -> None:
    own = diagnosed.verdict.calibration
    many = own.model_copy(update={"numbers": own.numbers + own.numbers[-1:] * 20})
    assert "<summary>12 more</summary>" in page(replace(diagnosed, verdict=verdict((), calibration=many)))


def test_text_of_a_log_cannot_become_markup(diagnosed: Diagnosis) -> None:
    evil = "<script>alert(1)</script>"
    run = diagnosed.runs[0]
    marked = replace(run, header=replace(run.header, command_sequence=evil))
    told = verdict(diagnosed.cells, nominal=evil, log_advice=(evil,))
    assert evil not in page(replace(diagnosed, runs=(marked,), verdict=told))


def test_the_first_line_says_what_it_does_and_what_to_do() -> None:
    """By hand, from the figures of the case: 4.2 of 0.4 becomes 1.0, 84 %; 1.52 becomes 1.31 m/s."""
    told = verdict((), status="explained", unknown=None)
    one = told.differences[0].model_copy(update={"group": ("coulomb_friction",)})
    good = consequences(gaps=told.consequences.gaps[:2] if told.consequences else ())
    near = tuple(g.model_copy(update={"ratio": 1.1}) for g in told.remainder)
    sure = told.model_copy(update={"differences": (one,), "consequences": good, "remainder": near})
    does = (
        "Dry friction at fl_kn: 2.02 N·m (1.91 to 2.13), P 0.71; calibration: knees give 86 % of the torque asked, "
        "forward hips (hy) 95 %, which closes 73 % of the torque gap; corrected, 84 % of the torque gap closes"
    )
    assert headline(sure) == f"{does}; next: train on the corrected model"
    assert is_good(sure)
    far = sure.model_copy(update={"remainder": told.remainder})
    assert headline(far) == headline(sure)
    blind = {"channels": {"set_point_to_load": "off: no measured joint torque"}}
    assert next_step(sure.model_copy(update=blind)) == "record the joint loads before training on the corrected model"
    worse = sure.model_copy(update={"consequences": told.consequences})
    assert not is_good(worse)
    assert headline(worse) == f"{does}; next: record more before training on the corrected model"
    foreign = {"no_model": "why"}
    assert headline(sure.model_copy(update=foreign)) == f"{does}; next: take the numbers over into your simulator"
    assert next_step(worse.model_copy(update=foreign)) == "record more before these numbers are used"
    off = {"status": "cannot_tell", "channels": {"set_point_to_load": "off: no measured joint torque"}}
    assert next_step(told.model_copy(update=off)) == "see why no channel shows forces (no measured joint torque)"
    assert next_step(told.model_copy(update=off | foreign)).endswith("--robot computes loads")
    warned = sure.model_copy(update={"warnings": ("it leans",)})
    assert headline(warned) == f"{does}; next: read the warnings"
    assert headline(told).endswith(
        "next: walk slowly and record it, to tell dry friction and friction near standstill (Stribeck) apart"
    )
    falls = consequences(changes=(FALLS, *consequences().changes))
    assert words.does(falls) == (
        "84 % of the torque gap closes (90 % interval: 77 % to 90 %); falls in 87 % of runs instead of 0 %"
    )


def test_what_is_merely_possible_is_not_stated_as_found(diagnosed: Diagnosis) -> None:
    one = verdict(()).differences[0].model_copy(update={"group": ("coulomb_friction",), "probability": 0.5})
    blind = {"set_point_to_load": "off: no measured joint torque"}
    told = verdict((), status="cannot_tell", differences=(one,), unknown=None, channels=blind)
    assert headline(told) == (
        "These logs cannot tell, since they hold no measured loads; possibly dry friction at fl_kn: 2.02 N·m (1.91 to "
        "2.13), P 0.50; next: record the joint loads: without them a drive and what it moves look alike"
    )
    text = page(replace(diagnosed, verdict=told))
    assert "<h1>These logs cannot tell, since they hold no measured loads</h1>" in text
    assert "Possibly dry friction at fl_kn" in text
    assert "train on" not in text


def test_of_several_numbers_the_headline_has_the_farthest_from_no_effect() -> None:
    tilt = {
        "roll_rad": Number(value=-0.0001, low=-0.015, high=0.015, unit="rad"),
        "pitch_rad": Number(value=0.0524, low=0.0363, high=0.0686, unit="rad"),
    }
    changes = {"name": "imu_tilt", "title": "tilted inertial unit", "group": ("imu_tilt",), "parameters": tilt}
    one = verdict(()).differences[0].model_copy(update=changes)
    assert words.found_in_full(one) == "tilted inertial unit: pitch 3° (2.08 to 3.93), P 0.71"
    swing = {"mass_kg": Number(value=6.0, low=5.0, high=7.0, unit="kg"), "x_m": Number(value=0.1, low=0.0, high=0.2)}
    assert "mass 6 kg (5 to 7)" in words.found_in_full(one.model_copy(update={"parameters": swing}))


@pytest.mark.parametrize(
    ("value", "unit", "told"),
    [
        ((0.00971, 0.0091, 0.0102), "s", "9.71 ms (9.1 to 10.2)"),
        ((0.25, 0.05, 0.4), "s", "0.25 s (0.05 to 0.4)"),
        ((0.0021,), "m", "2.1 mm"),
        ((0.0098,), "m/s", "0.0098 m/s"),
        ((0.05, 0.04, 0.06), "rad", "2.86° (2.29 to 3.44)"),
        ((0.655, 0.61, 0.7), "1", "0.655 (0.61 to 0.7)"),
        ((4848.2,), "N", "4850 N"),
    ],
)
def test_a_number_has_three_digits_and_a_unit_of_its_size(value: tuple[float, ...], unit: str, told: str) -> None:
    assert words.number(value[0], unit, *value[1:]) == told


@pytest.mark.parametrize(
    ("low", "high", "within"),
    [
        (0.43, 1.0, " (90 % interval: at least 43 %)"),
        (0.999, 1.0, ""),
        (0.43, 0.97, " (90 % interval: 43 % to 97 %)"),
        (None, None, ""),
    ],
)
def test_no_more_than_all_of_a_gap_closes(low: float | None, high: float | None, within: str) -> None:
    g = GapChange(gap="torque", unit="N·m", before=2.0, after=0.5, floor=0.3, share=0.88, low=low, high=high)
    assert words.gap_phrase(g) == f"88 % of the torque gap closes{within}"


@pytest.mark.parametrize(("ratios", "top"), [((40.0, 20.0), 40.0), ((1.1, 0.9), figures.LEAST_TOP)])
def test_colours_reach_to_the_largest_gap_and_a_faultless_robot_is_pale(ratios: tuple[float, ...], top: float) -> None:
    made = [
        GapCell(signal="load", joint="fl_kn", regime="all", gap=r, floor=1.0, ratio=r, p_value=None) for r in ratios
    ]
    assert figures.top_of(made) == top
    assert [figures.share_of(c, top) for c in made] == [max(r - 1.0, 0.0) / (top - 1.0) for r in ratios]
    assert figures.scale(made)[-1] == f"{top:g}×"


def test_calibration_alone_is_told_by_joint_type() -> None:
    told = verdict((), status="calibration", differences=(), unknown=None)
    assert headline(told).startswith(
        "Calibration: knees give 86 % of the torque asked, forward hips (hy) 95 %, which closes 73 % of the torque "
        "gap; corrected, 84 % of the torque gap closes; next: "
    )


def test_what_is_ordinary_but_closes_a_third_of_a_gap_is_told_first() -> None:
    """(1.0 − 0.79)/(1.0 − 0.4) is 35 %; friction that is named as a difference is not told again as calibration."""
    told = verdict((), status="calibration", differences=(), unknown=None)

    def first(after: float, **changes: Any) -> str:
        share = (1.0 - after) / (1.0 - 0.4)
        gap = GapChange(gap="torque", unit="N·m", before=1.0, after=after, floor=0.4, share=share)
        does = {"coulomb_friction": consequences(gaps=(gap,), changes=())}
        own = told.calibration.model_copy(update={"effects": does})
        return headline(told.model_copy(update={"calibration": own, **changes}))

    ordinary = "dry friction of forward hips (hy) is 0.12 N·m, nominal 0 N·m, which closes 35 % of the torque gap"
    out = "knees give 86 % of the torque asked, forward hips (hy) 95 %"
    assert first(0.79).startswith(f"Calibration: {ordinary}; {out}; corrected")
    assert first(0.81).startswith(f"Calibration: {out}; corrected")
    assert ordinary not in first(0.79, differences=verdict(()).differences)
    assert first(0.79, status="unknown_effect").startswith(
        f"Something may act that no effect of the library explains (P 0.35); calibration: {ordinary}; next: "
    )
    good = consequences(gaps=consequences().gaps[:2])
    assert first(0.79, consequences=good).endswith("next: train on the corrected model")


@pytest.mark.parametrize(
    ("group", "called"),
    [
        (("coulomb_friction", "armature", "backlash"), "dry friction or reflected rotor inertia or play in the gear"),
        (("coulomb_friction", "viscous_friction", "load_friction", "armature"), "something like friction"),
        (
            ("coulomb_friction", "viscous_friction", "backlash", "armature"),
            "one of 4 effects, dry friction among them",
        ),
        (("my_own", "another", "backlash", "armature"), "one of 4 effects, my own among them"),
    ],
)
def test_a_large_group_is_no_name_but_what_its_members_share(group: tuple[str, ...], called: str) -> None:
    changes = {"name": group[0], "title": "", "group": group, "parameters": {}}
    one = verdict(()).differences[0].model_copy(update=changes)
    assert words.found(one) == f"{called} at fl_kn"
    told = verdict((), differences=(one,))
    assert next_step(told).endswith(
        "to tell these 4 effects apart" if len(group) > 3 else "rotor inertia and play in the gear apart"
    )


@pytest.mark.parametrize("status", ["explained", "unknown_effect", "calibration", "no_gap", "cannot_tell"])
def test_a_verdict_with_little_in_it_still_makes_a_page(diagnosed: Diagnosis, status: str) -> None:
    nothing: tuple[()] = ()
    bare = verdict(
        nothing,
        status=status,
        differences=nothing,
        calibration=Calibration(),
        consequences=None,
        remainder=nothing,
        unknown=None,
        shrink=None,
        log_advice=nothing,
        invisible=nothing,
        timeline=nothing,
    )
    found = page(replace(diagnosed, verdict=bare, cells=(), simulated={}))
    assert "Gap map" not in found
    assert "None" not in found


def test_a_robot_without_a_gap_has_no_place_of_it(diagnosed: Diagnosis) -> None:
    assert "<h2>Where</h2>" in page(diagnosed)
    assert "<h2>Where</h2>" not in page(replace(diagnosed, verdict=verdict((), status="no_gap", differences=())))


def test_a_robot_without_a_picture_gets_a_row_of_colours() -> None:
    found = page(a_diagnosis(("hip", "knee"), differences=(), unknown=None))
    assert "Gap by signal, regime and joint: load error" in found
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
        "possible_robots.yaml",
        "report.html",
        "verdict.json",
    ]
    assert all(p.is_file() for p in paths.values())
    with pytest.raises(BadInputError, match=r"verdict.json exists; nothing is overwritten"):
        check_no_diagnosis(out)
