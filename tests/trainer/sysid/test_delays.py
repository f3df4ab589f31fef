from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spot_log import Run
from spot_model.errors import BadInputError
from spot_model.plant.delay import LogNormalDelay, read_delay_csv
from spot_model.robot.facts import PAPER_IDENTIFIED
from trainer.sysid.measured import delay_histogram, measure_delays, write_delay_csv

from .conftest import MakeLogs

PLANTED = LogNormalDelay(floor_s=0.0025, median_s=0.002, sigma=0.25)


@pytest.fixture(scope="module")
def delayed(make_logs: MakeLogs) -> list[Run]:
    return make_logs(PAPER_IDENTIFIED, sequences={"a": 0.0}, n_ticks=200, n_repeats=3, delay=PLANTED)


def test_the_planted_median_is_found(delayed: list[Run]) -> None:
    found = measure_delays(delayed)
    assert found.path_median_s == pytest.approx(0.0045, abs=0.0002)
    assert len(found.path_s) == pytest.approx(600, abs=6)


def test_the_histogram_draws_the_same_distribution(delayed: list[Run], tmp_path: Path) -> None:
    histogram = delay_histogram(measure_delays(delayed).path_s)
    write_delay_csv(histogram, tmp_path / "delay.csv")
    again = read_delay_csv(tmp_path / "delay.csv")
    drawn = again.sample(np.random.default_rng(0), 20_000)
    planted = PLANTED.sample(np.random.default_rng(1), 20_000)
    for q in (0.1, 0.5, 0.9):
        assert np.quantile(drawn, q) == pytest.approx(np.quantile(planted, q), abs=0.0003)


def test_clocks_that_do_not_fit_are_said(delayed: list[Run]) -> None:
    run = delayed[0]
    late = replace(run, commands=replace(run.commands, robot_stamp_ns=run.commands.robot_stamp_ns + 20_000_000))
    found = measure_delays([late])
    with pytest.raises(BadInputError, match="received before they were sent, by up to"):
        delay_histogram(found.transit_s)
    assert found.path_median_s == pytest.approx(0.0045, abs=0.0003)


def test_without_commands_there_is_none() -> None:
    with pytest.raises(BadInputError, match="no command's receipt is in the logs"):
        delay_histogram(measure_delays([]).path_s)
