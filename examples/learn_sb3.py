"""Train with Stable-Baselines3 on the vector environment, and export the result. Tried with version 2.9.2.

pip install stable-baselines3 && python examples/learn_sb3.py mine.onnx
"""

import sys

from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

import spot_rl


class _Robots(VecEnv):
    def __init__(self, env):
        self.env, spaces = env, (env.single_observation_space, env.single_action_space)
        super().__init__(env.num_envs, *spaces)

    def get_attr(self, name, indices=None):
        return [getattr(self.env, name)] * self.num_envs

    def reset(self):
        return self.env.reset(seed=self._seeds[0])[0]

    def step_async(self, actions):
        seen, reward, fell, timed_out, info = self.env.step(actions)
        infos = [{"TimeLimit.truncated": bool(late)} for late in timed_out]
        for robot in (fell | timed_out).nonzero()[0]:
            infos[robot]["terminal_observation"] = info["final_obs"][robot]
        self.step_wait = lambda: (seen, reward, fell | timed_out, infos)

    step_wait = close = set_attr = env_method = env_is_wrapped = lambda self, *_, **__: [False] * self.num_envs


env = spot_rl.make_vec_env(256, raw_actions=True)
ppo = PPO("MlpPolicy", _Robots(env), n_steps=24, batch_size=1536, policy_kwargs={"activation_fn": nn.ELU}, seed=0)
ppo.learn(3 * 24 * env.num_envs)  # three iterations; 1000 or more for a robot that walks
actor = nn.Sequential(ppo.policy.mlp_extractor.policy_net, ppo.policy.action_net)
print("policy:", spot_rl.export(actor, sys.argv[1] if sys.argv[1:] else "sb3.onnx", env=env))
