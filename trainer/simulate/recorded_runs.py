"""Whole recordings of a simulated robot: runs of a model under a policy, as the logs of real ones would be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from spot_log.read.run import Run
from spot_model.effects.base import CommandEffect, SoftwareEffect
from spot_model.io.model_file import RobotModel
from spot_model.plant.closed_loop import put_at
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.mjcf import MjcfOptions
from trainer.signals.policy_ticks import Script
from trainer.simulate import recorded_loop
from trainer.simulate.engine import available_threads
from trainer.simulate.recorded_loop import Course, RecordedLoop

SUBSTEPS: Final = 2
"""Physics steps between two states; one is enough to rank models, as a training's are longer still."""


@dataclass(frozen=True)
class UsualNoise(recorded_loop.SensorNoise):
    """A robot's usual noise."""

    position_rad: float = 3e-4
    velocity_rad_s: float = 0.03
    load_nm: float = 0.4
    linear_vel_m_s: float = 0.015
    angular_vel_rad_s: float = 0.01


def simulate_scripts(
    model: RobotModel,
    policy: Policy,
    scripts: Sequence[Script],
    rng: np.random.Generator,
    noise: UsualNoise,
    *,
    only_ticks: bool = False,
    device: str = "cpu",
    tell: Callable[[float], None] = lambda _: None,
) -> list[Run]:
    """Run all scripts, which have one tick period, in one batch.

    ``rng`` draws the sensors' noise and the delays; ``tell`` is called with the share that is done. With
    ``only_ticks`` no state is kept between the policy's ticks, and no loads of the links, and physics steps are as long
    as a state's period: enough to rank models by their gaits.
    ``device`` is where the physics runs: "cpu" or a GPU.

    Raises:
        ValueError: There are no scripts.
    """
    if not scripts:
        raise ValueError("no script to simulate")
    channel = [e for e in model.effects if isinstance(e, CommandEffect)]
    software = [e for e in model.effects if isinstance(e, SoftwareEffect)]
    own = [e for e in model.effects if not isinstance(e, (CommandEffect, SoftwareEffect))]
    substeps = 1 if only_ticks else SUBSTEPS
    step_s = facts.STATE_PERIOD_NS * 1e-9 / substeps
    mjcf = MjcfOptions(
        timestep_s=step_s, cone="elliptic", collision="all", link_torque_sensors=not only_ticks, visuals=False
    )
    options = PlantOptions(
        mjcf=mjcf,
        device=device,
        n_threads=available_threads(),
        on_divergence="flag",
        estimate_steps=substeps if device == "cpu" else 1,  # nobody sees one between two states
    )
    plant = Plant(own, len(scripts), options)
    last_action = put_at(plant, [script.start for script in scripts])
    loop = RecordedLoop(
        plant,
        policy,
        [Course(script.sequence, script.repeat, script.velocity_command) for script in scripts],
        start_setpoint_rad=np.asarray(policy.setpoint_rad(last_action)),
        last_action=last_action,
        channel=channel,
        rng=rng,
        noise=noise,
        software=software,
        only_ticks=only_ticks,
        tick_period_s=scripts[0].tick_period_s,
    )
    return loop.runs(tell)
