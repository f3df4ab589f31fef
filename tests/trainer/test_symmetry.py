import torch

from spot_model.policy.observation import N_OBSERVATION
from spot_model.robot import facts
from spot_model.robot.leg_kinematics import foot_position_in_body_m
from trainer.ppo.ppo import mirror_action, mirror_observation


def test_mirroring_twice_gives_the_same_back() -> None:
    x = torch.randn(7, N_OBSERVATION, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(mirror_observation(mirror_observation(x)), x, rtol=0, atol=0)
    torch.testing.assert_close(mirror_action(mirror_action(x[:, :12])), x[:, :12], rtol=0, atol=0)


def test_mirrored_joints_put_the_feet_at_the_mirror_image() -> None:
    offset = 0.3 * torch.randn(1, 12, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    pose = torch.tensor(facts.DEFAULT_POSITION_RAD)
    feet = foot_position_in_body_m(pose + offset)
    mirrored = foot_position_in_body_m(pose + mirror_action(offset))
    expected = feet[:, [1, 0, 3, 2]] * torch.tensor([1.0, -1.0, 1.0], dtype=torch.float64)
    torch.testing.assert_close(mirrored, expected)


def test_velocities_and_commands_change_their_lateral_and_yaw_signs() -> None:
    x = torch.zeros(1, N_OBSERVATION)
    x[0, :12] = torch.arange(1.0, 13.0)
    expected = [1, -2, 3, -4, 5, -6, 7, -8, 9, 10, -11, -12]
    assert mirror_observation(x)[0, :12].tolist() == expected
