"""Closed-loop runs of a model file: what a delivered model would train and identify in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from spot_log import Run
from spot_log.format.events import FOLLOWING_MODE
from spot_model.effects.base import CommandEffect, SoftwareEffect
from spot_model.io.model_file import RobotModel
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.plant.start import put_at
from spot_model.policy.policy import Policy
from spot_model.robot.mjcf import MjcfOptions
from trainer.signals.policy_ticks import start_of
from trainer.simulate.recorded_loop import RecordedLoop, Told
from trainer.sysid.logs import sequence_of
from withheld.features import Walk, walk_of_run

STEP_S: Final = 1e-3


def simulate(model: RobotModel, policy: Policy, runs: Sequence[Run], rng: np.random.Generator) -> list[Walk]:
    """Run a model from where each run started, and tell it what that run was told.

    Whether a robot at rest goes on standing or marches on the spot hangs on how the policy took over, and its gait a
    minute later on which of the two it did: runs compare only from the same start.

    Args:
        model: All of its effects act.
        policy: In the loop.
        runs: Logs with states and ticks.
        rng: Draws what effects draw.

    Raises:
        BadInputError: The model cannot be simulated.
    """
    followed = [_followed(run) for run in runs]
    channel = [e for e in model.effects if isinstance(e, CommandEffect)]
    software = [e for e in model.effects if isinstance(e, SoftwareEffect)]
    own = [e for e in model.effects if not isinstance(e, (CommandEffect, SoftwareEffect))]
    mjcf = MjcfOptions(timestep_s=STEP_S, cone="elliptic", collision="all", link_torque_sensors=True, visuals=False)
    plant = Plant(own, len(runs), PlantOptions(mjcf=mjcf, n_threads=1, on_divergence="flag"))
    last_action = put_at(plant, [start_of(run) for run in followed])
    loop = RecordedLoop(
        plant,
        policy,
        [Told(sequence_of(run), run.header.repeat, np.asarray(run.ticks.velocity_command)) for run in followed],
        start_setpoint_rad=np.asarray(policy.setpoint_rad(last_action)),
        last_action=last_action,
        channel=channel,
        rng=rng,
        software=software,
        only_ticks=True,
        tick_period_s=float(np.median([_tick_period_s(run) for run in followed])),
    )
    return [walk_of_run(run, policy) for run in loop.runs()]


def _followed(run: Run) -> Run:
    """The run with the ticks alone at which the policy followed its command."""
    rows = np.flatnonzero(run.ticks.mode == FOLLOWING_MODE)
    return replace(run, ticks=run.ticks.rows(rows))


def _tick_period_s(run: Run) -> float:
    """To a millisecond: programs run the policy at 50 Hz or at every sixth state, and some ticks slip."""
    stamps = run.ticks.robot_stamp_ns
    duration_s = float(stamps[-1] - stamps[0]) * 1e-9
    return round(1e3 * duration_s / (len(run.ticks) - 1)) * 1e-3
