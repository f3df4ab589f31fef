"""What logs show directly: planted delays and noise are found, and go into files and into the model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from spot_log import Run
from spot_model.errors import BadInputError
from spot_model.plant.delay import LogNormalDelay
from spot_model.policy.observation import OBSERVATION
from spot_model.policy.policy import policy_from_bytes
from spot_model.robot.facts import PAPER_IDENTIFIED
from trainer.config.task_config import TaskConfig
from trainer.signals.recording import record
from trainer.simulate.recorded_loop import SensorNoise
from trainer.sysid import measured
from trainer.sysid.measured import (
    ObservationNoise,
    delay_histogram,
    measure_delays,
    observation_noise,
    write_noise,
)

from .conftest import MakeLogs, oscillator_bytes

DELAY = LogNormalDelay(floor_s=0.0025, median_s=0.002, sigma=0.25)
NOISE = SensorNoise(position_rad=0.001, velocity_rad_s=0.1, load_nm=0.5, linear_vel_m_s=0.02, angular_vel_rad_s=0.05)


@pytest.fixture(scope="module")
def delayed(make_logs: MakeLogs) -> list[Run]:
    return make_logs(PAPER_IDENTIFIED, sequences={"a": 0.0}, n_ticks=200, n_repeats=3, delay=DELAY)


def test_planted_delays_are_found_and_drawn_again(delayed: list[Run]) -> None:
    found = measure_delays(delayed)
    assert found.path_median_s == pytest.approx(0.0045, abs=0.0002)
    assert len(found.path_s) == pytest.approx(600, abs=6)
    drawn = delay_histogram(found.path_s).sample(np.random.default_rng(0), 20_000)
    planted = DELAY.sample(np.random.default_rng(1), 20_000)
    for q in (0.1, 0.5, 0.9):
        assert np.quantile(drawn, q) == pytest.approx(np.quantile(planted, q), abs=0.0003)


def test_delays_that_cannot_be_are_left_out(delayed: list[Run], tmp_path: Path) -> None:
    run = delayed[0]
    late = replace(run, commands=replace(run.commands, robot_stamp_ns=run.commands.robot_stamp_ns + 20_000_000))
    found = measure_delays([late])
    assert found.path_median_s == pytest.approx(0.0045, abs=0.0003)
    noise = ObservationNoise(np.full(48, 0.01), np.full(12, 0.4))
    for number, delays in enumerate((found, measure_delays([]))):
        write_noise(noise, delays, tmp_path / f"{number}.yaml")
        assert set(yaml.safe_load((tmp_path / f"{number}.yaml").read_text())) == {"task", "sensors"}


def noise_of(runs: list[Run]) -> measured.ObservationNoise:
    return observation_noise([record(run) for run in runs])


def noise_sigma(signal: np.ndarray) -> np.ndarray:
    return measured._sigma_of_power(measured._stretch_power(signal, measured.SEGMENT), 333.0, measured.SEGMENT)


@pytest.mark.parametrize(("n", "within"), [(200, 0.4), (5000, 0.1)])
def test_white_noise_is_measured_as_it_is(n: int, within: float) -> None:
    sizes = np.array([0.01, 0.1, 1.0, 10.0])
    found = noise_sigma(np.random.default_rng(0).standard_normal((n, 4)) * sizes) / sizes
    assert np.all(np.abs(found - 1.0) < within)
    with pytest.raises(ValueError, match="at least 64 are needed"):
        noise_sigma(np.zeros(10))


def test_slow_motion_and_impacts_do_not_count() -> None:
    time_s = np.arange(4000) * 0.003
    motion = 5.0 * np.sin(2.0 * np.pi * 3.0 * time_s) + 2.0 * np.sin(2.0 * np.pi * 15.0 * time_s)
    noise = 0.1 * np.random.default_rng(1).standard_normal(4000)
    assert noise_sigma(motion + noise) == pytest.approx(0.1, rel=0.12)
    signal = 0.1 * np.random.default_rng(2).standard_normal((40_000, 4))
    signal[::400] += 5.0
    assert noise_sigma(signal) == pytest.approx(np.full(4, 0.1), rel=0.15)


@pytest.fixture(scope="module")
def calm(make_logs: MakeLogs) -> list[Run]:
    policy = policy_from_bytes(oscillator_bytes(swing=0.1, lift=0.2, rate_hz=1.0), source="calm")
    return make_logs(PAPER_IDENTIFIED, sequences={"a": 0.0}, n_ticks=250, n_repeats=2, noise=NOISE, with_policy=policy)


def test_stretches_in_which_the_set_points_move_do_not_count(make_logs: MakeLogs, calm: list[Run]) -> None:
    moving = make_logs(PAPER_IDENTIFIED, sequences={"a": 0.0}, n_ticks=250, n_repeats=2, noise=NOISE)
    found = noise_of([*moving, *calm]).block("joint_velocity_rad_s")
    assert found == pytest.approx(np.full(12, 0.1), rel=0.25)
    assert noise_of(moving).block("joint_velocity_rad_s").max() > 0.15


def test_planted_noise_of_every_feature_is_found_and_written(calm: list[Run], tmp_path: Path) -> None:
    found = noise_of(calm)
    planted = (0.02, 0.05, None, 0.001, 0.1)
    for block, sigma in zip([field.name for field in OBSERVATION if field.noise], planted, strict=True):
        if sigma is not None:
            assert found.block(block) == pytest.approx(np.full_like(found.block(block), sigma), rel=0.15), block
    assert found.load_nm == pytest.approx(np.full(12, 0.5), rel=0.15)
    assert np.all(found.block("velocity_command") == 0.0)
    assert np.all(found.block("last_action") == 0.0)
    write_noise(found, measure_delays([]), tmp_path / "noise.yaml")
    data = yaml.safe_load((tmp_path / "noise.yaml").read_text())
    assert TaskConfig.model_validate(data["task"]).noise.joint_position_rad > 0.0
    sensors = {"position_rad", "velocity_rad_s", "load_nm", "attitude_rad"}
    assert set(data["sensors"]) == {*sensors, "body_velocity_m_s", "body_angular_velocity_rad_s"}
    with pytest.raises(BadInputError, match="exists; nothing is overwritten"):
        write_noise(found, measure_delays([]), tmp_path / "noise.yaml")
