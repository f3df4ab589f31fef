from types import SimpleNamespace

import numpy as np
import pytest

from diagnosis.sober import load_error_share, sober


def _views(error: float) -> dict[str, object]:
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
    assert sober("no_gap", _views(0.1)) == ("no_gap", "")
    status, note = sober("no_gap", _views(0.8))
    assert status == "cannot_tell"
    assert "80 % of their size" in note
    assert sober("explained", _views(0.8)) == ("explained", "")
