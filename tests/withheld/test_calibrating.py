"""The ensemble on which probabilities are calibrated, and their fit on made-up evidence."""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from withheld.cases import kind_of

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(autouse=True)
def _scripts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [str(BENCHMARKS), *sys.path])


def explanation(rng: np.random.Generator, *, is_there: bool, lacks: bool) -> dict[str, Any]:
    """An effect with 40 nats where it is there and 4 where not, and an excess of 6 where something is lacking."""
    nats = (40.0 if is_there else 4.0) * rng.uniform(0.5, 2.0)
    effect = {"nats": nats, "own_nats": nats, "joints": ["fl_kn"], "is_in_group": is_there}
    return {
        "library": ["torque_gain"],
        "effects": [effect],
        "excess": {"set_point_to_load": rng.normal(6.0 if lacks else 0.0, 0.5)},
        "left_nats": {"set_point_to_load": rng.uniform(0.0, 5.0)},
        "errors": 1.0,
        "closed": {},
    }


def test_blocks_of_robots_hold_each_kind() -> None:
    import calibrate_diagnosis

    numbers = list(islice(calibrate_diagnosis.ensemble(5), 40))
    assert [kind_of(5, n) for n in numbers] == [*calibrate_diagnosis.ORDER] * 5
    assert len(set(numbers)) == 40


def test_a_fit_tells_what_is_there_and_what_is_lacking(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import calibrate_diagnosis

    rng = np.random.default_rng(1)
    for number in range(60):
        is_faulty, lacks = number % 3 > 0, number % 3 == 2
        names = ["other"] if lacks else ["torque_gain"]
        row = {
            "number": number,
            "n_runs": 15,
            "faults": [{"names": names, "moved": 3.0}] if is_faulty else [],
            "whole": explanation(rng, is_there=is_faulty and not lacks, lacks=lacks),
        }
        (tmp_path / f"1-{number:04d}.json").write_text(json.dumps(row))
    calibrate_diagnosis.fit(Namespace(folder=tmp_path))
    said = capsys.readouterr().out
    assert "60 robots, 20 of them faultless" in said
    assert "THERE: 60 effects, 20 there" in said
    assert "UNKNOWN: 60 explanations, 20 lack something" in said
    losses = [float(line.split("log loss ")[1].split(",")[0]) for line in said.splitlines() if "log loss" in line]
    assert min(losses) < 0.1 < np.log(2) < 1.0
    assert "gap: too few" in said


def test_few_robots_are_refused(tmp_path: Path) -> None:
    import calibrate_diagnosis

    with pytest.raises(SystemExit, match="too few"):
        calibrate_diagnosis.fit(Namespace(folder=tmp_path))
