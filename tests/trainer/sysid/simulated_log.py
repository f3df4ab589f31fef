"""Logs of a simulated robot: other time step, integrator, cone and contact than the search's."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from spot_log import Run
from spot_model.effects.base import CommandEffect
from spot_model.io.model_file import RobotModel
from spot_model.plant.delay import ConstantDelay, Delay
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.mjcf import MjcfOptions, default_height_m
from trainer.simulate.recorded_loop import RecordedLoop, SensorNoise, Told

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class DrawnDelay(CommandEffect):
    """Each command is as late as a distribution says."""

    name: ClassVar[str] = "drawn_delay"

    delay: Delay

    def arrival_s(self, issued_s: Array, rng: np.random.Generator) -> Array:
        return issued_s + self.delay.sample(rng, len(issued_s))


@dataclass(frozen=True)
class SimulatedRobot:
    """A robot that makes logs."""

    model: RobotModel
    """Hidden truth; its command delay is not used, ``delay`` is."""
    noise: SensorNoise = SensorNoise()
    delay: Delay = field(default_factory=lambda: ConstantDelay(delay_s=facts.TRAINING_COMMAND_DELAY_S))
    """From the state's stamp to the receipt of the command that answers it."""
    mjcf: MjcfOptions = field(
        default_factory=lambda: MjcfOptions(
            timestep_s=0.001,
            integrator="implicitfast",
            cone="elliptic",
            contact_solref=(0.008, 1.0),
            collision="feet",
            link_torque_sensors=True,
        )
    )


def simulate_logs(
    robot: SimulatedRobot,
    policy: Policy,
    sequence: str,
    velocity_command: Array,
    n_repeats: int,
    rng: np.random.Generator,
) -> list[Run]:
    """Run one command sequence several times.

    Args:
        robot: What makes the logs.
        policy: The policy.
        sequence: Name of the sequence.
        velocity_command: One command a policy tick, shape (n_ticks, 3).
        n_repeats: Number of runs; they differ by noise, delays and a slightly different start.
        rng: Source of all differences.
    """
    effects = [e for e in robot.model.effects if not isinstance(e, CommandEffect)]
    plant = Plant(effects, n_repeats, PlantOptions(mjcf=robot.mjcf, n_threads=1))
    pose = facts.DEFAULT_POSITION_RAD + 0.02 * rng.standard_normal((n_repeats, facts.N_JOINTS))
    plant.reset(joint_position_rad=pose, position_of_body_in_world_m=(0.0, 0.0, default_height_m() + 0.01))
    loop = RecordedLoop(
        plant,
        policy,
        [Told(sequence, i, velocity_command) for i in range(n_repeats)],
        start_setpoint_rad=pose,
        last_action=np.zeros((n_repeats, facts.N_JOINTS), dtype=np.float32),
        channel=[DrawnDelay(delay=robot.delay)],
        rng=rng,
        noise=robot.noise,
    )
    return loop.runs()
