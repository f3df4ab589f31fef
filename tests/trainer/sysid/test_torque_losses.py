from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spot_model.robot import facts
from trainer.sysid.config import SysidConfig
from trainer.sysid.torque_losses import SIMPSON, fit_losses, window_starts
from trainer.sysid.torque_model import TorqueModel, TorqueSamples

MODEL = TorqueModel(SysidConfig().space())
PERIOD_S = facts.STATE_PERIOD_NS * 1e-9
FRICTION_NM = np.where(np.arange(12) % 3 == 2, 0.4, 0.1)
INERTIA_KG_M2 = np.where(np.arange(12) % 3 == 2, 0.07, 0.04)


def swinging(n_states: int = 3000, offset_s: float = 0.0015, noise: float = 0.0) -> TorqueSamples:
    """Joints that swing about their default at 2 to 4 Hz, without limits; set-points change every sixth state."""
    rng = np.random.default_rng(0)
    rate = 2.0 * np.pi * rng.uniform(2.0, 4.0, 12)

    def motion(time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        phase = rate * time_s[:, None]
        size = 0.1
        return (
            facts.DEFAULT_POSITION_RAD + size * np.sin(phase),
            size * rate * np.cos(phase),
            -size * rate**2 * np.sin(phase),
            -size * rate**3 * np.cos(phase),
        )

    time_s = np.arange(n_states) * PERIOD_S
    state = np.flatnonzero(np.arange(n_states) % 6 != 0)
    setpoint = facts.DEFAULT_POSITION_RAD + 0.1 * rng.standard_normal((n_states // 6 + 1, 12))
    setpoint = setpoint[state // 6]
    position, velocity, acceleration, jerk = motion(time_s[state])
    then_position, then_velocity, _, _ = motion(time_s[state] - offset_s)
    _, _, halfway, _ = motion(time_s[state] - 0.5 * offset_s)
    request = 60.0 * (setpoint - then_position) - 1.5 * then_velocity
    load = request - FRICTION_NM * np.sign(then_velocity) - INERTIA_KG_M2 * halfway
    one = np.ones_like(position)
    return TorqueSamples(
        run=state * 4 // n_states,
        state=state,
        setpoint_rad=setpoint,
        position_rad=position,
        velocity_rad_s=velocity + noise * rng.standard_normal(velocity.shape),
        acceleration_rad_s2=acceleration,
        jerk_rad_s3=jerk,
        velocity_doubt_rad_s=0.0 * one,
        kp_nm_per_rad=60.0 * one,
        kd_nm_s_per_rad=1.5 * one,
        load_nm=load + 10.0 * noise * rng.standard_normal(load.shape),
    )


WIDE = np.array([0.0, 0.0, 160.0, -160.0, 40.0, -40.0, 30.0, -30.0])


def test_exact_motion_gives_back_friction_and_inertia() -> None:
    found = fit_losses(MODEL, swinging(), WIDE, 0.0015)
    assert found is not None
    assert found.columns == (0, 1)
    assert found.values == pytest.approx([0.1, 0.4], abs=0.004)
    assert found.inertia_kg_m2 == pytest.approx([0.04, 0.07], rel=0.01)
    assert found.viscosity_nm_s_per_rad == pytest.approx([0.0, 0.0], abs=0.002)
    assert found.n_runs.tolist() == [4, 4]


def test_noise_widens_the_interval_and_leaves_the_value() -> None:
    found = fit_losses(MODEL, swinging(noise=0.01), WIDE, 0.0015)
    assert found is not None
    assert found.values == pytest.approx([0.1, 0.4], abs=0.03)
    errors = np.sqrt(np.diag(found.by_run) + np.diag(found.by_leg))
    assert np.all((errors > 0.0005) & (errors < 0.03))


def test_samples_at_a_limit_are_left_out() -> None:
    tight = WIDE.copy()
    tight[2:4] = 5.0, -5.0
    free, bound = (fit_losses(MODEL, swinging(), values, 0.0015) for values in (WIDE, tight))
    assert free is not None
    assert bound is not None
    assert bound.n_windows[1] < free.n_windows[1]
    assert bound.n_windows[0] == free.n_windows[0]


def test_windows_do_not_span_runs_gaps_or_setpoints() -> None:
    samples = swinging(61)
    assert window_starts(samples).tolist() == [5 * k for k in range(10) if samples.run[5 * k] == samples.run[5 * k + 4]]
    assert len(window_starts(samples.rows(np.arange(4)))) == 0
    moved = replace(samples, setpoint_rad=samples.setpoint_rad + np.arange(len(samples))[:, None])
    assert len(window_starts(moved)) == 0
    assert fit_losses(MODEL, swinging(30), WIDE, 0.0015) is None


def test_the_weights_integrate_cubics_exactly() -> None:
    x = np.arange(5.0)
    for power in range(4):
        assert SIMPSON @ x**power == pytest.approx(4.0 ** (power + 1) / (power + 1) / 4.0)
