"""The reality of docs/add-a-reality.md, as it stands there: 40 lines at most, and a robot that hides what it says."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from spot_log import read_run
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint
from tests.docs.blocks import blocks_of
from withheld.plan import RecordingPlan
from withheld.realities.source import source_of

ROOT = Path(__file__).parents[2]


def test_the_pages_reality_records_what_it_hides(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (code,) = (b.text for b in blocks_of(ROOT / "docs" / "add-a-reality.md") if b.order == "file rubbing.py")
    assert len([line for line in code.splitlines() if line.strip()]) <= 40
    (tmp_path / "rubbing.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "rubbing", raising=False)
    reality = source_of("rubbing:RubbingKnees").make((), 5)
    assert 2.0 <= 6.0 * reality.truth.faults[0].size <= 6.0
    ahead = VelocitySequence(name="ahead", duration_s=1.0, waypoints=(Waypoint(time_s=0.0, v_x_m_s=0.3),))
    logs = tmp_path / "logs"
    logs.mkdir()
    reality.record(RecordingPlan(ROOT / "policies" / "walk.onnx", (ahead,), 1, seed=1), logs)
    (path,) = logs.iterdir()
    assert path.suffix == ".mcap"
    assert "ahead" not in path.name
    run = read_run(path)
    assert (run.header.command_sequence, run.outcome) == ("ahead", "completed")
    assert np.isfinite(run.states.load_nm).all()
