"""Parts of pages: what is text is escaped, what is a number stands to the right."""

from __future__ import annotations

import re

import numpy as np

from spot_log.page.chart import Series, Shade, chart, histogram
from spot_log.page.look import Html, boxed, facts, framed, headed, note, table
from spot_log.page.rows import stance

EVIL = "<b>&</b>"


def test_text_is_escaped_everywhere_and_html_is_not():
    parts = [
        boxed(EVIL, EVIL, table([EVIL], [[EVIL]])),
        facts([(EVIL, EVIL)]),
        note(EVIL),
        headed(EVIL, "", EVIL, [EVIL]),
    ]
    text = framed(EVIL, parts)
    assert EVIL not in text
    assert text.count("&lt;b&gt;&amp;&lt;/b&gt;") == 11
    assert EVIL in table([], [[Html(EVIL)]])


def test_numbers_of_a_table():
    found = table(["a"], [[3], [1.23456], [None], [True], ["x"]], row_classes=["good"] * 5)
    cells = ['<td class="number">3</td>', '<td class="number">1.235</td>', '<td class="number">—</td>']
    assert all(cell in found for cell in [*cells, "<td>True</td>", "<td>x</td>"])
    assert found.count('<tr class="good">') == 5


def numbers(pattern, picture):
    """What a pattern's groups hold, as numbers, one row a match."""
    return np.array([[float(v) for v in found] for found in re.findall(pattern, picture)])


def test_a_stance_diagram_has_a_bar_for_each_stance():
    contact = np.array([[1, 0], [1, 1], [0, 1], [1, 0]], dtype=bool)
    picture = stance(contact, ("fl", "fr"), "red", width=114, span_s=(0.0, 4.0))
    bars = numbers(r'<rect x="([\d.]+)" y="([\d.]+)" width="([\d.]+)"[^>]*fill:red', picture)
    # The plot runs from 62 to 102, ten a sample.
    np.testing.assert_allclose(bars, [[62, 4, 20], [92, 4, 10], [72, 22, 20]])
    assert ">2 s</text>" in picture
    assert stance(contact, ("fl",), "red") == ""


def test_a_line_lies_where_its_numbers_say_and_breaks_where_they_are_missing():
    y = np.array([0.0, 1.0, np.nan, 1.0, 0.0])
    picture = chart([Series("red", np.arange(5.0), y)], "v, m/s", width=474, height=112, zero=True)
    lines = re.findall(r'points="([^"]*)" style="fill:none;stroke:red', picture)
    # 400 wide from 62 for 0 to 4; 0 at the bottom (120), 1 below the top by 6 % of the range (8 + 112 · 0.06/1.06).
    assert lines == ["62.0,120.0 162.0,14.3", "362.0,14.3 462.0,120.0"]
    assert chart([Series("red", np.arange(2.0), [np.nan, np.nan])], "v") == ""


def test_a_stepped_line_holds_each_value_until_the_next():
    stepped = Series("red", np.arange(5.0), [0.0, 0.0, 1.0, 1.0, 1.0], is_stepped=True)
    (way,) = re.findall(r'points="([^"]*)" style="fill:none;stroke:red', chart([stepped], "v", width=474, zero=True))
    assert [point.split(",")[0] for point in way.split()] == ["62.0", "262.0", "262.0", "462.0"]


def test_an_instant_is_a_stripe_that_can_be_seen():
    lines = [Series("blue", [0.0, 4.0], [0.0, 1.0])]
    picture = chart(lines, "v", width=474, shades=[Shade(2.0, 2.0, "late", "red"), Shade(-9.0, 1.0, "", "green")])
    late, early = numbers(r'<rect x="([\d.]+)" y="[\d.]+" width="([\d.]+)"', picture)
    np.testing.assert_allclose(late, [262, 1.5])
    np.testing.assert_allclose(early, [62, 100])


def test_a_histogram_tells_its_percentiles_and_what_lies_beyond():
    values = np.concatenate([np.linspace(0.0, 10.0, 1001), [500.0], [np.nan]])
    picture = histogram(values, "wait, ms")
    assert "median 5.005, 99 % below 9.91" in picture
    # 99.5 % lie up to 9.95995.
    assert "6 more, up to 500" in picture
    assert sum(int(count) for count in re.findall(r'data-t="(\d+) from', picture)) == 996
    assert "not known" in histogram([np.nan], "wait, ms")
