"""Peers of the diagnosis in lab/benchmarks/: each finds what is planted where its means allow it."""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.library.registry import LIBRARY

CLAIMS = Path(__file__).parents[2] / "lab" / "benchmarks" / "claims"


@pytest.fixture(autouse=True)
def _scripts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(CLAIMS))
    monkeypatch.setattr(sys, "path", list(sys.path))


def test_least_squares_ranks_by_what_healthy_robots_scatter_by() -> None:
    import least_squares

    healthy = [np.full((12, 6), 0.1) for _ in range(3)]
    own = np.full((12, 6), 0.1)
    own[4, 1], own[7, 0] = 0.9, -0.5
    told = least_squares.ranking(own, healthy)
    assert max(told, key=lambda name: told[name]) == "viscous_friction"
    assert told["viscous_friction"] == pytest.approx(9.0)
    assert told["coulomb_friction"] == pytest.approx(5.0)
    assert told["armature"] == pytest.approx(1.0)


def test_a_candidate_scales_the_distance_from_null_within_bounds() -> None:
    from closed_loop_ranking import Candidate

    gain = Candidate(LIBRARY["torque_gain"], ("kn",), {"gain": 0.8})
    assert gain.scaled(np.array([np.log(2.0), 5.0])).values == {"gain": pytest.approx(0.6)}
    assert gain.scaled(np.array([-20.0])).values["gain"] == pytest.approx(1.0, abs=1e-6)
    low = next(p.low for p in LIBRARY["torque_gain"].effect.parameters() if p.name == "gain")
    assert gain.scaled(np.array([20.0])).values["gain"] == low


def test_the_nearest_candidate_speaks_for_its_effect() -> None:
    from closed_loop_ranking import Candidate, nearest

    tried = [Candidate(LIBRARY[name], ("all",), {}) for name in ("armature", "torque_gain", "armature")]
    assert nearest(tried, np.array([3.0, 2.0, 1.5])) == {"armature": -1.5, "torque_gain": -2.0}


def test_the_table_counts_what_each_means_ranks_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import diagnosis_peers as script

    seconds = dict.fromkeys(script.MEANS, 1.0)
    for number in range(4):
        is_faulty = number >= 2
        own = np.full((12, 6), 0.1 + 0.01 * number)
        own[0, 1] = 5.0 if is_faulty else 0.1
        row = {
            "number": number,
            "seconds": seconds,
            "faults": [{"names": ["viscous_friction"], "moved": 3.0}] if is_faulty else [],
            "least_squares": own.tolist(),
            "mujoco": [0.1 + 0.01 * number] * 7 + ([2.0] * 2 if is_faulty else [0.1 + 0.01 * number] * 2) + [17.0],
            "network": [float(number)] * 12,
            "ours": {
                "gap": 0.9 if is_faulty else 0.1,
                "effects": {"viscous_friction": 0.9} if is_faulty else {},
                "named": [{"names": ["viscous_friction"], "p": 0.9}] if number else [],
                "is_silent": number == 0,
            },
            "two_sample": {"gap": 1.0, "effects": {"armature": -1.0, "viscous_friction": -2.0} if is_faulty else {}},
            "cma_es": {"gap": 1.0, "effects": {"armature": -1.0} if is_faulty else {}},
        }
        (tmp_path / f"{number}.json").write_text(json.dumps(row))
    script.table(Namespace(folder=tmp_path, below=9))
    told = json.loads(capsys.readouterr().out.split("\n\n|")[0])
    assert told["ours"]["first"].startswith("100 % (2/2")
    assert told["least_squares"]["first"].startswith("100 % (2/2")
    assert told["two_sample"]["first"].startswith("0 % (0/2")
    assert told["two_sample"]["first_three"].startswith("100 % (2/2")
    assert told["cma_es"]["first_three"].startswith("0 % (0/2")
    assert told["mujoco"]["first"].startswith("100 % (2/2")
    assert told["ours"]["false_alarms"].startswith("0 % (0/2")
    # It names something on one of the robots without a fault, with P 0.9; the others are there.
    assert told["ours_alone"]["false_alarms"].startswith("50 % (1/2")
    assert told["ours_alone"]["calibration_error"].startswith("0.23 (3")
    assert told["network"]["roc_area"].startswith("1.00")
    assert told["two_sample"]["roc_area"].startswith("0.50")
