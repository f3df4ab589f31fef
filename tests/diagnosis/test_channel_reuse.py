"""What the body's channels compute once and use again has the bits of what is computed from nothing."""

from dataclasses import fields, replace

import numpy as np
import pytest

from diagnosis.channels import Channel
from diagnosis.channels.build import build_views
from diagnosis.channels.dynamics import DynamicsSignals, residuals
from diagnosis.channels.kinematics import StanceSignals, feet
from diagnosis.channels.stack import stack
from trainer.signals.recording import record

from .cases import NOMINAL
from .planted import Truth, planted_runs, walk_sequence


@pytest.fixture(scope="module")
def signals() -> tuple[DynamicsSignals, StanceSignals]:
    views, _ = build_views(
        stack([record(run) for run in planted_runs(Truth(), 1, sequence=walk_sequence(3.0))]), NOMINAL
    )
    return views[Channel.LOAD_TO_MOTION].signals, views[Channel.STANCE_KINEMATICS].signals


@pytest.mark.parametrize("name", ["load_nm", "position_rad", "velocity_rad_s", "acceleration_rad_s2"])
def test_changed_inputs_use_what_they_leave_as_it_is(signals: tuple[DynamicsSignals, StanceSignals], name: str) -> None:
    d, _ = signals
    changes = {name: getattr(d.inputs, name) + 0.01 * (np.arange(12) == 4)}
    new, afresh = d.with_inputs(("test", name), **changes), residuals(d.model, replace(d.inputs, **changes))
    for f in fields(new):
        np.testing.assert_array_equal(getattr(new, f.name), getattr(afresh, f.name))
    assert not np.array_equal(new.base, d.reference.base)


@pytest.mark.parametrize("joints", [[7], [3, 4, 5], [0, 11]])
@pytest.mark.parametrize("name", ["position_rad", "velocity_rad_s"])
def test_one_leg_that_differs_is_computed_alone(
    signals: tuple[DynamicsSignals, StanceSignals], name: str, joints: list[int]
) -> None:
    _, k = signals
    changes = {name: getattr(k.inputs, name) - 0.01 * np.isin(np.arange(12), joints)}
    afresh = feet(replace(k.inputs, **changes), k.standing)
    new = k.corrected(("test", name, *joints), **changes)
    np.testing.assert_array_equal(new, k.stack.smooth(afresh, k.rows))
    assert not np.array_equal(new, k.nominal)


def test_one_foot_that_is_worn(signals: tuple[DynamicsSignals, StanceSignals]) -> None:
    _, k = signals
    radius = k.inputs.foot_radius_m - np.array([0.0, 0.0, 0.004, 0.0])
    afresh = feet(replace(k.inputs, foot_radius_m=radius), k.standing)
    np.testing.assert_array_equal(k.corrected("worn", foot_radius_m=radius), k.stack.smooth(afresh, k.rows))
