"""What robots without a fault look like: which cases they are, one of them made, and the fit on made-up ones."""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diagnosis.decision_constants import LEAST_NATS
from diagnosis.library.registry import LIBRARY
from diagnosis.selection.faultless import Faultless
from withheld.cases import kind_of

BENCHMARKS = Path(__file__).parents[2] / "lab" / "benchmarks"


@pytest.fixture(autouse=True)
def _scripts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [str(BENCHMARKS), *sys.path])


def row(rng: np.random.Generator, *, is_closed: bool) -> dict[str, Any]:
    """Friction adds exponentially much, 2 nats in the mean, a gain next to nothing; what is left is normal."""
    gains = {"coulomb_friction": rng.exponential(2.0), "torque_gain": -1.0}
    kept = {"gains": gains, "named": {}, "left": {"set_point_to_load": rng.normal(0.5, 0.5)}}
    return kept | ({"gaps": {"torque": rng.normal(0.1, 0.1)}} if is_closed else {})


def test_only_cases_without_a_fault_are_made() -> None:
    import calibrate_diagnosis

    numbers = list(islice(calibrate_diagnosis.faultless_cases(5), 10))
    assert {kind_of(5, n) for n in numbers} == {"faultless"}
    assert numbers == sorted(set(numbers))


def test_the_fit_knows_what_is_usual(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import calibrate_diagnosis

    rng = np.random.default_rng(1)
    for number in range(400):
        (tmp_path / f"1-{number:04d}.json").write_text(json.dumps(row(rng, is_closed=number < 60)))
    to = tmp_path / "faultless.txt"
    calibrate_diagnosis.fit(Namespace(folder=tmp_path, to=to))
    assert "400 robots, 60 of them in closed loop" in capsys.readouterr().out
    found = Faultless.model_validate_json(to.read_text())
    assert found.robots == 400
    share = calibrate_diagnosis.FALSE_ALARMS / len(LIBRARY)
    assert found.price("coulomb_friction") == pytest.approx(-2.0 * np.log(share), rel=0.2)
    assert found.price("torque_gain") == LEAST_NATS
    load = found.left["set_point_to_load"]
    assert (load.median, load.tenth) == pytest.approx((0.5, 0.5 + 0.5 * 1.28), abs=0.1)
    assert load.tail(load.at(0.01)) == pytest.approx(0.01)
    assert set(found.left) == {"set_point_to_load", "torque"}


def test_few_robots_are_refused(tmp_path: Path) -> None:
    import calibrate_diagnosis

    with pytest.raises(SystemExit, match="too few"):
        calibrate_diagnosis.fit(Namespace(folder=tmp_path, to=tmp_path / "faultless.json"))


@pytest.mark.slow
def test_one_robot_is_kept_with_what_every_effect_would_add_and_what_is_left(tmp_path: Path) -> None:
    import calibrate_diagnosis

    number = next(calibrate_diagnosis.faultless_cases(1))
    assert "core-seconds" in calibrate_diagnosis.robot(1, number, False, tmp_path, np.inf)
    (file,) = tmp_path.glob("*.json")
    kept = json.loads(file.read_text())
    assert {"coulomb_friction", "torque_gain"} <= kept["gains"].keys() <= LIBRARY.keys()
    assert kept["named"].keys() <= kept["gains"].keys()
    assert "set_point_to_load" in kept["left"]
    assert 0.5 <= kept["error_scale"] <= 5.0
    assert calibrate_diagnosis.robot(1, number, False, tmp_path, np.inf) == f"{number}: there"
