"""A chart that stands by itself has a size, all its lines and their names, and nothing of a page's style."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import numpy as np
import pandas as pd
import pytest

from spot_log.page.picture import COLOURS, plot

RISING = pd.Series(np.linspace(0.0, 1.0, 50), index=np.linspace(0.0, 5.0, 50))


def test_a_picture_stands_by_itself() -> None:
    shown = plot({"asked": RISING, "was <done>": 0.9 * RISING}, "speed, m/s", width=600)._repr_svg_()
    root = ET.fromstring(shown)  # noqa: S314 - our own picture
    assert root.attrib["width"] == "600"
    assert float(root.attrib["height"]) > 190
    assert all(colour in shown for colour in COLOURS[:2])
    assert {"asked", "was <done>", "speed, m/s"} <= {
        text.text for text in root.iter("{http://www.w3.org/2000/svg}text")
    }
    assert set(re.findall(r"var\((--\w+)\)", shown)) <= {"--line"}


@pytest.mark.parametrize(("lines", "why"), [({}, "nothing to draw"), (dict.fromkeys("abcde", RISING), "at most 4")])
def test_what_cannot_be_drawn_is_said(lines: dict[str, pd.Series], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        plot(lines, "m/s")
