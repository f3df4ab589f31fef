from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.sober import load_error_share, sober
from diagnosis.verdict import Shrink, Status


def _views(error: float) -> dict[str, Any]:
    rng = np.random.default_rng(0)
    load = rng.standard_normal((500, 2)) * np.array([10.0, 0.01])
    view = SimpleNamespace(
        response=error * load, usable=np.ones((500, 2), dtype=bool), noise=np.array([0.1, 0.1]),
        signals=SimpleNamespace(load_nm=load, finish=lambda x: x),
    )  # fmt: skip
    return {"A": view}


def test_the_share_is_of_joints_that_carry_something() -> None:
    assert load_error_share(_views(0.25)) == pytest.approx(0.25)
    assert load_error_share({}) == 0.0


def test_plain_errors_are_not_called_no_gap() -> None:
    assert sober("no_gap", _views(0.1), None) == ("no_gap", "")
    status, note = sober("no_gap", _views(0.8), None)
    assert status == "cannot_tell"
    assert "80 % of their size" in note
    assert sober("explained", _views(0.8), None) == ("explained", "")


@pytest.mark.parametrize(
    ("status", "after", "floor", "said"),
    [
        ("explained", 4.0, 1.0, "partly_explained"),
        ("explained", 2.4, 1.0, "explained"),
        ("explained", 2.4, 0.5, "partly_explained"),
        ("explained", 9.0, 0.0, "explained"),  # without repeats there is no unit to compare in
        ("unknown_effect", 4.0, 1.0, "unknown_effect"),
    ],
)
def test_what_widens_the_gap_does_not_explain_it(status: Status, after: float, floor: float, said: Status) -> None:
    shrink = Shrink(d0=2.0, d1=after, floor=floor, s=None, s_low=None, s_high=None, held_out=(), placebo=None)
    found, note = sober(status, {}, shrink)
    assert found == said
    assert ("farther from the robot" in note) == (said != status)
