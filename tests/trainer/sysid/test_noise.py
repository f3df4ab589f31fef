from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from spot_log import Run
from spot_model.errors import BadInputError
from spot_model.policy.observation import OBSERVATION
from spot_model.policy.policy import policy_from_bytes
from spot_model.robot.facts import PAPER_IDENTIFIED
from trainer.signals.recording import record
from trainer.simulate.recorded_loop import SensorNoise
from trainer.sysid import measured as estimate
from trainer.sysid.measured import observation_noise, write_noise

from .conftest import MakeLogs, oscillator_bytes

PLANTED = SensorNoise(position_rad=0.001, velocity_rad_s=0.1, load_nm=0.5, linear_vel_m_s=0.02, angular_vel_rad_s=0.05)


def noise_of(runs: list[Run]) -> estimate.ObservationNoise:
    return observation_noise([record(run) for run in runs])


def noise_sigma(signal: np.ndarray, rate_hz: float) -> np.ndarray:
    power = estimate._stretch_power(signal, estimate.SEGMENT)
    return estimate._sigma_of_power(power, rate_hz, estimate.SEGMENT)


@pytest.mark.parametrize("n", [200, 5000])
def test_white_noise_is_measured_as_it_is(n: int) -> None:
    noise = np.random.default_rng(0).standard_normal((n, 4)) * np.array([0.01, 0.1, 1.0, 10.0])
    found = noise_sigma(noise, 333.0) / np.array([0.01, 0.1, 1.0, 10.0])
    assert np.all(np.abs(found - 1.0) < (0.4 if n == 200 else 0.1))


def test_a_large_slow_motion_does_not_count() -> None:
    rng = np.random.default_rng(1)
    time_s = np.arange(4000) * 0.003
    motion = 5.0 * np.sin(2.0 * np.pi * 3.0 * time_s) + 2.0 * np.sin(2.0 * np.pi * 15.0 * time_s)
    assert noise_sigma(motion + 0.1 * rng.standard_normal(4000), 333.0) == pytest.approx(0.1, rel=0.12)


def test_impacts_in_some_stretches_do_not_count() -> None:
    signal = 0.1 * np.random.default_rng(2).standard_normal((40_000, 4))
    signal[::400] += 5.0
    assert noise_sigma(signal, 333.0) == pytest.approx(np.full(4, 0.1), rel=0.15)


def test_stretches_in_which_the_set_points_move_do_not_count(make_logs: MakeLogs) -> None:
    calm = policy_from_bytes(oscillator_bytes(swing=0.1, lift=0.2, rate_hz=1.0), source="calm")
    moving = make_logs(PAPER_IDENTIFIED, sequences={"a": 0.0}, n_ticks=250, n_repeats=2, noise=PLANTED)
    still = make_logs(PAPER_IDENTIFIED, sequences={"a": 0.0}, n_ticks=100, n_repeats=2, noise=PLANTED, with_policy=calm)
    found = noise_of([*moving, *still]).block("joint_velocity_rad_s")
    assert found == pytest.approx(np.full(12, 0.1), rel=0.25)
    assert noise_of(moving).block("joint_velocity_rad_s").max() > 0.15


def test_planted_noise_of_every_feature_is_found_while_the_robot_moves(make_logs: MakeLogs) -> None:
    calm = policy_from_bytes(oscillator_bytes(swing=0.1, lift=0.2, rate_hz=1.0), source="calm")
    runs = make_logs(PAPER_IDENTIFIED, sequences={"a": 0.0}, n_ticks=250, n_repeats=2, noise=PLANTED, with_policy=calm)
    found = noise_of(runs)
    planted = (0.02, 0.05, None, 0.001, 0.1)
    for block, sigma in zip([field.name for field in OBSERVATION if field.noise], planted, strict=True):
        if sigma is not None:
            assert found.block(block) == pytest.approx(np.full_like(found.block(block), sigma), rel=0.15), block
    assert found.load_nm == pytest.approx(np.full(12, 0.5), rel=0.15)
    assert np.all(found.block("velocity_command") == 0.0)
    assert np.all(found.block("last_action") == 0.0)


def test_the_file_holds_what_trainer_and_fake_robot_take(make_logs: MakeLogs, tmp_path: Path) -> None:
    runs = make_logs(PAPER_IDENTIFIED, sequences={"a": 0.0}, n_ticks=50, n_repeats=1, noise=PLANTED)
    write_noise(noise_of(runs), tmp_path / "noise.yaml")
    data = yaml.safe_load((tmp_path / "noise.yaml").read_text())
    from trainer.config.task_config import TaskConfig

    task = TaskConfig.model_validate(data["task"])
    assert task.noise.joint_position_rad > 0.0
    assert set(data["sensors"]) == {
        "position_rad",
        "velocity_rad_s",
        "load_nm",
        "body_velocity_m_s",
        "body_angular_velocity_rad_s",
        "attitude_rad",
    }
    with pytest.raises(BadInputError, match="exists; nothing is overwritten"):
        write_noise(noise_of(runs), tmp_path / "noise.yaml")


def test_a_signal_without_a_whole_stretch_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 64 are needed"):
        noise_sigma(np.zeros(10), 333.0)
