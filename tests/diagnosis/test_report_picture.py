import xml.etree.ElementTree as ET

from diagnosis.report.spot_picture import colour, picture
from spot_model.facts import JOINT_NAMES


def test_every_joint_is_drawn_with_its_figure() -> None:
    gaps = {name: float(i) for i, name in enumerate(JOINT_NAMES)}
    drawn = ET.fromstring(picture(gaps, frozenset({"fl_kn"})))  # noqa: S314 - our own text
    titles = [e.text for e in drawn.iter() if e.tag == "title"]
    assert titles == [f"{name}: {gaps[name]:.2f}" for name in JOINT_NAMES]
    ringed = [g for g in drawn.iter("g") if g.find("circle").get("stroke") == "#1f4fbf"]
    assert [g.find("title").text for g in ringed] == ["fl_kn: 2.00"]


def test_the_largest_gap_is_the_darkest() -> None:
    shades = [sum(int(colour(s)[k : k + 2], 16) for k in (1, 3, 5)) for s in (0.0, 0.3, 0.7, 1.0)]
    assert shades == sorted(shades, reverse=True)
    assert colour(2.0) == colour(1.0)
