"""Parts of pages: what is text is escaped, what is a number stands to the right, and a chart lies where it should."""

from __future__ import annotations

import re

import numpy as np
import pytest

from spot_log.page.charts import histogram, stance
from spot_log.page.render import as_html, rendered
from spot_log.page.sections import (
    Bar,
    Bars,
    Beside,
    Cell,
    Chart,
    Fold,
    Head,
    Items,
    Legend,
    Map,
    Mark,
    Section,
    Series,
    Shade,
    SpotMap,
    Table,
)

EVIL = "<b>&'\""
PARTS = [
    Head(EVIL, "good", EVIL, [EVIL], EVIL),
    Section(EVIL, EVIL, [EVIL, Mark(EVIL, "note"), Mark(EVIL, "pre"), Section(EVIL, EVIL, (EVIL, Mark(EVIL)))]),
    Beside([Fold(EVIL, Items([EVIL, Mark(EVIL, "code")])), Mark(EVIL, "", EVIL)], 3),
    Table([EVIL], [[EVIL]]),
    Table((), [(EVIL, EVIL)]),
    Legend([("red", EVIL)]),
    Chart([Series("red", [0, 1], [0, 1], has_points=True, name=EVIL)], EVIL, EVIL, EVIL, EVIL, EVIL),
    Chart([Series("red", [0, 1], [0, 0])], shades=[Shade(0, 1, EVIL)], rows=[EVIL]),
    Bars([(EVIL, EVIL, [Bar(0.5, "red", EVIL, EVIL)])], EVIL),
    Map([EVIL], [(EVIL, [Cell(0.5, EVIL, EVIL)])], EVIL, EVIL, [EVIL]),
    SpotMap({"fl_kn": Cell(0.5, EVIL)}, ["fl_kn"], [EVIL]),
]


def test_text_is_escaped_everywhere():
    text = rendered(EVIL, PARTS)
    assert "<b>&'" not in text
    assert text.count("&lt;b&gt;&amp;&#x27;&quot;") >= 40


@pytest.mark.parametrize(
    "part",
    [
        Section("a", "b", [Fold("c", Items(())), Table(("d",), ()), Mark("", "note"), None, "", Legend([("red", "")])]),
        Beside([Section("a", "b", Chart([Series("red", [0, 1], [np.nan, np.nan])], "v"))]),
        Fold("a", Section("b", "", ())),
    ],
)
def test_what_has_nothing_to_show_is_left_out(part):
    assert as_html(part) == ""


def test_numbers_of_a_table():
    found = as_html(Table(["a"], [[3], [1.23456], [None], [True], ["x"]], ["good"] * 5))
    cells = ['<td class="number">3</td>', '<td class="number">1.235</td>', '<td class="number">—</td>']
    assert all(cell in found for cell in [*cells, "<td>True</td>", "<td>x</td>"])
    assert found.count("<tr class='good'>") == 5


def test_a_section_within_a_section_has_a_small_heading():
    found = as_html(Section("one", "", Section("two", "", "three")))
    assert found == "<section><h2>one</h2><div><h3>two</h3><p>three</p></div></section>"


def ways(picture, colour="red"):
    """The corners of lines of a colour."""
    return re.findall(rf'points="([^"]*)" style="fill:none;stroke:{colour}', picture)


def test_a_stance_diagram_has_a_bar_for_each_stance():
    contact = np.array([[1, 0], [1, 1], [0, 1], [1, 0]], dtype=bool)
    picture = as_html(stance(contact, ("fl", "fr"), "red", (0.0, 4.0)))
    # The plot is 1000 wide, 250 a sample; rows are 18 high.
    assert ways(picture) == ["0.0,9.0 500.0,9.0", "750.0,9.0 1000.0,9.0", "250.0,27.0 750.0,27.0"]
    assert ">2 s</text>" in picture
    assert "</text>" not in as_html(stance(contact[:, :1], ("fl",), "red")).replace(">fl</text>", "")
    assert stance(contact, ("fl",), "red") is None


def test_a_line_lies_where_its_numbers_say_and_breaks_where_they_are_missing():
    y = np.array([0.0, 1.0, np.nan, 1.0, 0.0])
    picture = as_html(Chart([Series("red", np.arange(5.0), y)], "v, m/s", height=112, zero=True))
    # 0 at the bottom; 1 below the top by 6 % of the range, 112 · 0.06/1.06.
    assert ways(picture) == ["0.0,112.0 250.0,6.3", "750.0,6.3 1000.0,112.0"]


def test_a_stepped_line_holds_each_value_until_the_next():
    stepped = Series("red", np.arange(3.0), [0.0, 1.0, 0.0], is_stepped=True)
    (way,) = ways(as_html(Chart([stepped], "v", height=106, zero=True)))
    assert way == "0.0,106.0 500.0,106.0 500.0,6.0 1000.0,6.0 1000.0,106.0"


def test_an_instant_is_a_stripe_that_can_be_seen():
    shades = [Shade(2.0, 2.0, "late", "red"), Shade(-9.0, 1.0, "", "green")]
    picture = as_html(Chart([Series("blue", [0.0, 4.0], [0.0, 1.0])], "v", shades=shades))
    assert re.findall(r'<rect x="([\d.]+)" y="0" width="([\d.]+)"', picture) == [("500.0", "1.5"), ("0.0", "250.0")]


def test_a_histogram_tells_its_percentiles_and_what_lies_beyond():
    values = np.concatenate([np.linspace(0.0, 10.0, 1001), [500.0], [np.nan]])
    chart = histogram(values, "wait, ms")
    assert "median 5.005, 99 % below 9.91" in chart.about
    # 99.5 % lie up to 9.95995.
    assert "6 more, up to 500" in chart.about
    assert np.sum(chart.lines[0].y) / 2 == 996
    assert "not known" in as_html(histogram([np.nan], "wait, ms"))
