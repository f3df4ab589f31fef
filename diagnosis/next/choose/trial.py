"""One experiment on many simulated robots at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from diagnosis.closed_loop.merged_models import merged
from diagnosis.closed_loop.simulation import SensorNoise, simulate
from diagnosis.next.choose.candidates import Motion
from diagnosis.read.policy_ticks import Script
from spot_log.read.run import Run
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.io.velocity_sequence import VelocitySequence
from spot_model.plant.start import StartState
from spot_model.policy.joint_script import joint_script
from spot_model.policy.policy import Policy
from spot_model.robot import facts

STATE_S: Final = facts.STATE_PERIOD_NS * 1e-9
STAND_S: Final = 1.0
"""Robots stand for so long before the motion begins; it is a part of the runs."""


def try_on(
    motion: Motion,
    models: Sequence[RobotModel],
    policy: Policy | None,
    rng: np.random.Generator,
    tick_period_s: float | None = None,
) -> tuple[Run, ...]:
    """Runs of an experiment, one a robot, with every state of the stream.

    Args:
        motion: What is run.
        models: The robots.
        policy: For velocity sequences.
        rng: Draws sensors' noise and delays.
        tick_period_s: Of the program that will run it; by default the contract's.

    Raises:
        BadInputError: A velocity sequence needs a policy, or asks for more than it knows, a joint experiment breaks its
            bounds, or the robots cannot be simulated side by side.
    """
    together = merged(models)
    if together is None:
        raise BadInputError("these robots cannot be simulated side by side: an effect has a number a run already")
    if isinstance(motion, VelocitySequence):
        if policy is None:
            raise BadInputError(f"experiment {motion.name} is a walk; give the policy with --policy")
        if motion.clipped(np.array(policy.command_low), np.array(policy.command_high)) != motion:
            raise BadInputError(
                f"experiment {motion.name} asks for more than the policy knows: V_x, V_y (m/s), ω_z (rad/s) from "
                f"{_numbers(policy.command_low)} to {_numbers(policy.command_high)}"
            )
        controller, rate_hz = policy, 1.0 / tick_period_s if tick_period_s else policy.contract.rate_hz
        asked = motion.sampled(rate_hz)
    else:
        controller = joint_script(motion)
        rate_hz = controller.contract.rate_hz
        asked = controller.motion.sampled(rate_hz)
    stand = np.zeros((round(STAND_S * rate_hz), asked.shape[1]))
    still, joints = np.zeros(3), np.zeros(facts.N_JOINTS)
    start = StartState(
        facts.DEFAULT_POSITION_RAD, joints, np.array([1.0, 0.0, 0.0, 0.0]), still, still, joints.astype(np.float32)
    )
    command = np.concatenate([stand, asked])
    scripts = [Script(motion.name, number, start, command, 1.0 / rate_hz) for number in range(len(models))]
    return tuple(simulate(together, controller, scripts, rng, SensorNoise()))


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{v:g}" for v in values)
