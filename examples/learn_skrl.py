"""Train with skrl on the vector environment, and export the result. Tried with version 2.1.1.

pip install skrl && python examples/learn_skrl.py mine.onnx
"""

import sys

from skrl.agents.torch.ppo import PPO, PPO_CFG
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.trainers.torch import SequentialTrainer
from skrl.utils.model_instantiators.torch import deterministic_model, gaussian_model

import spot_rl

env = spot_rl.make_vec_env(256, raw_actions=True)
robots = wrap_env(env)
kinds = {"observation_space": robots.observation_space, "action_space": robots.action_space, "device": robots.device}
layers = [{"name": "net", "input": "OBSERVATIONS", "layers": [128, 64], "activations": "elu"}]
policy = gaussian_model(**kinds, network=layers, output="ACTIONS", initial_log_std=0.0)
value = deterministic_model(**kinds, network=layers, output="ONE")
quiet = {"write_interval": 0, "checkpoint_interval": 0}
memory = RandomMemory(memory_size=24, num_envs=env.num_envs, device=robots.device)
agent = PPO(
    models={"policy": policy, "value": value}, memory=memory, cfg=PPO_CFG(rollouts=24, experiment=quiet), **kinds
)
SequentialTrainer(
    env=robots, agents=agent, cfg={"timesteps": 72, "headless": True}
).train()  # 3 iterations: 1000 to walk
print("policy:", spot_rl.export(policy.net_container, sys.argv[1] if sys.argv[1:] else "skrl.onnx", env=env))
