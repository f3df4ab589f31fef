"""Parts of pages: what is text is escaped, what is a number stands to the right."""

from __future__ import annotations

import numpy as np

from spot_log.page.cells import Html, facts, note, table
from spot_log.page.draw import plot, stance_diagram
from spot_log.page.look import boxed, framed, headed

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


def test_a_figure_that_is_not_there_is_said():
    assert "no data" in plot(None, "x")


def test_a_stance_diagram_has_a_bar_for_each_stance():
    contact = np.array([[1, 0], [1, 1], [0, 1], [1, 0]], dtype=bool)
    first, second = stance_diagram(np.arange(4.0), contact, ("fl", "fr")).data
    assert list(first.x) == [0.0, 1.0, None, 3.0, 3.0, None]
    assert list(second.x) == [1.0, 2.0, None]
    assert (first.name, second.name) == ("fl", "fr")
