"""The gait at each forward speed, as a policy's contract states it."""

from __future__ import annotations

import numpy as np

from spot_model.io.model_file import RobotModel
from spot_model.policy.contract import StatedGait
from spot_model.policy.policy import Policy
from trainer.evaluate.figures import gait
from trainer.evaluate.rollout import roll_out
from trainer.evaluate.setting import Setting

SPEEDS_M_S = (0.3, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)
RAMP_S, SETTLE_S, WATCH_S = 4.0, 2.0, 4.0


def stated_gaits(policy: Policy, model: RobotModel) -> tuple[StatedGait, ...]:
    """Walk one robot a speed, up to the policy's own, and measure; a robot that falls has the gait "fall"."""
    top = policy.contract.velocity_command_high[0]
    speeds = [v for v in SPEEDS_M_S if v <= top + 1e-9]
    if not speeds:
        return ()
    target = np.array([[v, 0.0, 0.0] for v in speeds])
    rate, steady_s = policy.contract.rate_hz, RAMP_S + SETTLE_S
    recording = roll_out(
        policy,
        Setting(policy=policy, model=model).plant(len(target)),
        lambda tick: target * min(1.0, (tick + 1) / (RAMP_S * rate)),
        round((steady_s + WATCH_S) * rate),
    )
    span = recording.ticks(steady_s, steady_s + WATCH_S)
    stated = []
    for robot, speed in enumerate(speeds):
        figures = gait(recording, span, robot)
        stated.append(
            StatedGait(
                v_x_m_s=speed,
                name=figures["gait"] if recording.survived[robot] else "fall",
                **{key: figures[key] for key in StatedGait.model_fields if key in figures},
            )
        )
    return tuple(stated)
