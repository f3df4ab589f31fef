import numpy as np
import pytest
import torch

from spot_model.effects.base import Motion
from spot_model.effects.command.command_delay import CommandDelay
from spot_model.effects.command.command_jitter import CommandJitter
from spot_model.effects.sensing.encoder_offset import EncoderOffset
from spot_model.errors import BadInputError
from spot_model.io.model_file import load_model
from spot_model.plant.command_channel import ServoCommand
from spot_model.plant.plant import Plant
from trainer.backends.torch_servo import DelayedSetpoints, TorchTorqueChain, refuse_other_effects

N = 5
DELAYS = np.array([[0.0], [0.003], [0.005], [0.021], [0.0401]])


def test_delayed_setpoints_arrive_when_the_plants_channel_says() -> None:
    effect = CommandDelay(delay_s=DELAYS)
    plant = Plant((effect,), N)
    rest = torch.from_numpy(plant.joint_position_rad).float()
    setpoints = DelayedSetpoints((effect,), rest, 0.005, 4)
    channel = plant._channel
    for period in range(6):
        sent = np.full((N, 12), float(period + 1))
        channel.issue(ServoCommand(position_rad=sent), period * 0.02)
        setpoints.issue(torch.from_numpy(sent).float())
        for substep in range(4):
            expected = np.broadcast_to(channel.at(period * 0.02 + substep * 0.005).position_rad, (N, 12))
            np.testing.assert_allclose(setpoints.at(substep).numpy(), expected, rtol=1e-6)


def test_one_delay_for_all_takes_the_short_way_to_the_same_result() -> None:
    rest = torch.zeros(2, 12)
    setpoints = DelayedSetpoints((CommandDelay(delay_s=0.005),), rest, 0.005, 4)
    setpoints.issue(torch.ones(2, 12))
    assert [float(setpoints.at(k)[0, 0]) for k in range(4)] == [0.0, 1.0, 1.0, 1.0]


def test_reset_drops_what_is_under_way() -> None:
    setpoints = DelayedSetpoints((CommandDelay(delay_s=0.03),), torch.zeros(2, 12), 0.005, 4)
    setpoints.issue(torch.ones(2, 12))
    setpoints.reset(torch.tensor([True, False]), torch.full((2, 12), 7.0))
    setpoints.issue(torch.full((2, 12), 2.0))
    assert float(setpoints.at(3)[0, 0]) == 7.0
    assert float(setpoints.at(3)[1, 0]) == 1.0


def test_a_delay_that_changes_is_refused() -> None:
    with pytest.raises(BadInputError, match=r"command_jitter.*only constant delays"):
        DelayedSetpoints((CommandJitter(mean_s=0.002),), torch.zeros(2, 12), 0.005, 4)


def test_torque_is_that_of_the_plant() -> None:
    effects = load_model("paper_identified").effects
    rng = np.random.default_rng(0)
    position = rng.uniform(-1.0, 1.0, (N, 12)) + np.tile([0.0, 0.9, -1.5], 4)
    velocity = rng.uniform(-20.0, 20.0, (N, 12))
    goal = position + rng.uniform(-2.0, 2.0, (N, 12))
    plant = Plant(effects, N)
    motion = Motion(position, velocity, 0.005)
    expected = plant._torques.torque_nm(ServoCommand(position_rad=goal), motion, motion)
    tensors = [torch.from_numpy(a) for a in (goal, position, velocity)]
    chain = TorchTorqueChain(effects, torch.zeros(N, 12, dtype=torch.float64))
    np.testing.assert_allclose(chain.torque_nm(*tensors, 0.005).numpy(), expected, rtol=1e-12, atol=1e-12)
    assert np.abs(expected).max() < 114.0


def test_effects_without_a_place_on_a_gpu_are_refused() -> None:
    refuse_other_effects(load_model("paper_identified").effects)
    with pytest.raises(BadInputError, match=r"encoder_offset acts at sensor.*train on the CPU"):
        refuse_other_effects((EncoderOffset(offset_rad=0.01),))
