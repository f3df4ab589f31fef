"""From a checkpoint to an ONNX file that describes itself, its gait included."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from spot_model.io.model_file import RobotModel
from spot_model.io.models_file import load_models
from spot_model.io.whole import check_new, whole_file
from spot_model.policy.contract import StatedGait
from spot_model.policy.policy import Policy, policy_from_bytes
from trainer.evaluate.setting import Setting
from trainer.ppo.checkpoint import find_checkpoint
from trainer.ppo.checkpoint_policy import check_agreement, onnx_bytes, read_actor
from trainer.simulate.walks import hold

SPEEDS_M_S = (0.3, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)
RAMP_S, SETTLE_S, WATCH_S = 4.0, 2.0, 4.0


def stated_gaits(policy: Policy, model: RobotModel) -> tuple[StatedGait, ...]:
    """Walk one robot a speed, up to the policy's own, and measure; a robot that falls has the gait "fall"."""
    top = policy.contract.velocity_command_high[0]
    speeds = [v for v in SPEEDS_M_S if v <= top + 1e-9]
    if not speeds:
        return ()
    target = np.array([[v, 0.0, 0.0] for v in speeds])
    steady_s = RAMP_S + SETTLE_S
    plant = Setting(policy=policy, model=model).plant(len(target))
    recording = hold(policy, plant, target, RAMP_S, steady_s + WATCH_S)
    span = recording.ticks(steady_s, steady_s + WATCH_S)
    stated = []
    for robot, speed in enumerate(speeds):
        figures = recording.gait(span, robot)
        stated.append(
            StatedGait(
                v_x_m_s=speed,
                name=figures["gait"] if recording.survived[robot] else "fall",
                **{key: figures[key] for key in StatedGait.model_fields if key in figures},
            )
        )
    return tuple(stated)


def export_policy(run: Path, out: Path, name: str | None = None) -> Path:
    """Write the newest checkpoint's actor as ONNX with its contract; refuses to overwrite.

    Args:
        run: A run folder, or a checkpoint.
        out: The file to write.
        name: Name in the contract; the config's by default.

    Raises:
        OutputExistsError: ``out`` exists.
        BadInputError: There is no checkpoint, or the networks disagree by more than 1e-5.
    """
    check_new(out)
    config, layers, contract = read_actor(find_checkpoint(run), name)
    measured = stated_gaits(
        policy_from_bytes(onnx_bytes(layers, contract), source="export"), load_models(config.model)[0]
    )
    data = onnx_bytes(layers, contract.model_copy(update={"gait": measured}))
    check_agreement(layers, data)
    with whole_file(out) as part:
        part.write_bytes(data)
    return out
