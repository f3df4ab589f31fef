"""A walking robot whose log says nowhere when commands were received: its delay is seen in what new set-points do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.read.prepare import _after_steps, rows_apart
from spot_log.read.run import Run
from spot_model.effects.friction import ViscousFriction
from spot_model.plant.delay import ConstantDelay

from .planted import Truth, planted_runs, walk_sequence


def _without_receipts(run: Run) -> Run:
    return replace(run, states=replace(run.states, last_command_key=np.zeros_like(run.states.last_command_key)))


@pytest.mark.parametrize("delay_ms", [3.0, 10.0])
@pytest.mark.parametrize("damping_nm_s_per_rad", [0.0, 1.0])
def test_a_delay_is_found_and_friction_is_not_taken_for_one(delay_ms: float, damping_nm_s_per_rad: float) -> None:
    truth = Truth(transport=ConstantDelay(delay_s=delay_ms * 1e-3))
    if damping_nm_s_per_rad:
        truth = replace(truth, effects=(ViscousFriction(damping_nm_s_per_rad=damping_nm_s_per_rad),))
    runs = [_without_receipts(run) for run in planted_runs(truth, 1, sequence=walk_sequence(3.0))]
    period_ms = 1e-6 * float(np.median(np.diff(runs[0].states.robot_stamp_ns)))
    # Half a state for a load that lags here by nothing, and a third for the grid of the states.
    assert abs(rows_apart(runs) * period_ms - delay_ms) < 0.85 * period_ms


def test_a_load_that_never_changes_answers_no_step() -> None:
    run = _without_receipts(planted_runs(Truth(), 1, sequence=walk_sequence(1.5))[0])
    dead = replace(run, states=replace(run.states, load_nm=np.ones_like(run.states.load_nm)))
    assert _after_steps([dead]) is None
