"""Train with rsl_rl on the vector environment, and export the result. Tried with rsl-rl-lib 5.5.1.

python examples/learn_rsl_rl.py mine.onnx
"""

import sys

import torch
from rsl_rl.env import VecEnv
from rsl_rl.runners import OnPolicyRunner
from tensordict import TensorDict

import spot_rl


class _Robots(VecEnv):
    def __init__(self, env, device="cpu"):
        self.env, self.num_envs, self.num_actions, self.device, self.cfg = env, env.num_envs, 12, device, {}
        self.max_episode_length, self.episode_length_buf = 1000, torch.zeros(env.num_envs, dtype=torch.long)
        self.seen, _ = env.reset(seed=0)

    def get_observations(self):
        return TensorDict({"policy": torch.from_numpy(self.seen)}, batch_size=[self.num_envs])

    def step(self, actions):
        self.seen, reward, fell, timed_out, _ = self.env.step(actions.numpy())
        done, outs = torch.from_numpy(fell | timed_out), {"time_outs": torch.from_numpy(timed_out)}
        return self.get_observations(), torch.from_numpy(reward), done, outs


env = spot_rl.make_vec_env(256, raw_actions=True)
network = {"class_name": "MLPModel", "hidden_dims": [128, 64], "activation": "elu"}
# The export takes the whole actor: with its normaliser, if it has one ("obs_normalization": True).
actor = {**network, "distribution_cfg": {"class_name": "GaussianDistribution", "init_std": 1.0}}
groups = {"actor": ["policy"], "critic": ["policy"]}
ppo = {"algorithm": {"class_name": "PPO"}, "num_steps_per_env": 24, "save_interval": 1000, "obs_groups": groups}
runner = OnPolicyRunner(_Robots(env), {**ppo, "actor": actor, "critic": network}, log_dir=None)
runner.learn(3)  # 1000 or more for a robot that walks
print("policy:", spot_rl.export(runner.alg.actor, sys.argv[1] if sys.argv[1:] else "rsl_rl.onnx", env=env))
