from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

import spot_rl
from spot_log.read.run import Run

REPOSITORY = Path(__file__).resolve().parents[2]
WALK = REPOSITORY / "policies" / "walk.onnx"


BRISK = {"power": {"power_on_s": 0.2, "power_off_s": 0.1}, "motion": {"stand_s": 0.8, "sit_s": 0.8}}
"""The default robot, but quicker to its feet."""


@pytest.fixture(scope="module")
def walks(tmp_path_factory: pytest.TempPathFactory) -> list[Run]:
    """Two short walks of one fake robot."""
    logs = tmp_path_factory.mktemp("walks") / "logs"
    with spot_rl.FakeSpot(BRISK) as spot:
        return [spot.walk(WALK, velocity=(0.8, 0.0, 0.0), duration_s=3.0, log_dir=logs) for _ in range(2)]


@pytest.fixture
def in_project() -> Iterator[None]:
    """The working folder of somebody who has policies/ in it."""
    before = Path.cwd()
    os.chdir(REPOSITORY)
    yield
    os.chdir(before)
