"""Closed-loop runs of a model under the logs' policy and commands, as logs: for shrink, traces, map and synthesis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from diagnosis.read.policy_ticks import Script
from spot_log.read.run import Run
from spot_model.effects.base import CommandEffect, SoftwareEffect
from spot_model.io.model_file import RobotModel
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.plant.start import put_at
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.mjcf import MjcfOptions
from trainer.shared.threads import available_threads
from trainer.sysid.simulation import recorded_loop
from trainer.sysid.simulation.recorded_loop import RecordedLoop, Told

SUBSTEPS: Final = 2
"""Physics steps between two states."""


@dataclass(frozen=True)
class SensorNoise(recorded_loop.SensorNoise):
    """A robot's usual noise."""

    position_rad: float = 3e-4
    velocity_rad_s: float = 0.03
    load_nm: float = 0.4
    linear_vel_m_s: float = 0.015
    angular_vel_rad_s: float = 0.01


def simulate(
    model: RobotModel,
    policy: Policy,
    scripts: Sequence[Script],
    rng: np.random.Generator,
    noise: SensorNoise,
    *,
    only_ticks: bool = False,
    effects_seed: int | np.random.Generator = 0,
    least_ticks: int = 0,
    tell: Callable[[float], None] = lambda _: None,
) -> list[Run]:
    """Run all scripts, which have one tick period, in one batch.

    ``rng`` draws the sensors' noise and the delays, ``effects_seed`` what the other effects draw; ``tell`` is called
    with the share that is done. With ``only_ticks`` no state is kept between the policy's ticks, and no loads of the
    links: enough to compare gaits. A part of a batch is simulated for the ``least_ticks`` of the whole.

    Raises:
        ValueError: There are no scripts.
    """
    if not scripts:
        raise ValueError("no script to simulate")
    channel = [e for e in model.effects if isinstance(e, CommandEffect)]
    software = [e for e in model.effects if isinstance(e, SoftwareEffect)]
    own = [e for e in model.effects if not isinstance(e, (CommandEffect, SoftwareEffect))]
    step_s = facts.STATE_PERIOD_NS * 1e-9 / SUBSTEPS
    mjcf = MjcfOptions(
        timestep_s=step_s, cone="elliptic", collision="all", link_torque_sensors=not only_ticks, visuals=False
    )
    options = PlantOptions(mjcf=mjcf, n_threads=available_threads(), on_divergence="flag", seed=effects_seed)
    plant = Plant(own, len(scripts), options)
    last_action = put_at(plant, [script.start for script in scripts])

    def arrival_s(issued_s: Array) -> Array:
        for effect in channel:
            issued_s = np.broadcast_to(effect.arrival_s(issued_s, rng), (len(scripts),))
        return issued_s

    loop = RecordedLoop(
        plant,
        policy,
        [Told(script.sequence, script.repeat, script.velocity_command) for script in scripts],
        start_setpoint_rad=np.asarray(policy.setpoint_rad(last_action)),
        last_action=last_action,
        arrival_s=arrival_s,
        rng=rng,
        noise=noise,
        software=software,
        only_ticks=only_ticks,
        tick_period_s=scripts[0].tick_period_s,
        least_ticks=least_ticks,
    )
    return loop.runs(tell)
