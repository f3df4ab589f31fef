"""A peer of the diagnosis: the residual of an actuator network (Hwangbo et al., 2019).

A small network learns, from simulated walks of the nominal model, a joint's torque from three samples of its position
error and velocity; one network for each type of joint. Where a robot's torques are farther off than those of simulated
walks that it did not learn from, something differs at that joint, be it an ordinary error. It says where, and not what.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import torch
from numpy.typing import NDArray

from spot_log.read.run import Run
from spot_model.robot import facts

Array = NDArray[np.float64]

LAGS: Final = (0, 3, 6)
"""States, of 3 ms."""
SCALE: Final = torch.tensor([0.2] * len(LAGS) + [5.0] * len(LAGS))
TORQUE_NM: Final = 20.0
EPOCHS: Final = 300
BATCH: Final = 2048
SAMPLES: Final = 60_000
"""Of a type of joint, at most."""


def ratios(healthy: Sequence[Run], robot: Sequence[Run], seed: int) -> Array:
    """By joint, root mean square residual on the robot over that on healthy runs held out, shape (12,).

    Every third of the healthy runs is held out.
    """
    rng, found = np.random.default_rng(seed), np.zeros(facts.N_JOINTS)
    learned = [run for i, run in enumerate(healthy) if i % 3]
    held_out = [run for i, run in enumerate(healthy) if not i % 3]
    for kind in range(3):
        joints = range(kind, facts.N_JOINTS, 3)
        x, y = _together([samples(run, j) for run in learned for j in joints])
        rows = rng.permutation(len(x))[:SAMPLES]
        network = _trained(x[rows], y[rows], seed)
        for j in joints:
            off = [_rms(network, *_together([samples(run, j) for run in runs])) for runs in (robot, held_out)]
            found[j] = off[0] / off[1]
    return found


def samples(run: Run, joint: int) -> tuple[Array, Array]:
    """Inputs, shape (n, 2·len(LAGS)), and measured torques, shape (n,), while commands stiffen as the policy's do."""
    states, commands = run.states, run.commands
    at = np.minimum(np.searchsorted(commands.key, states.last_command_key), len(commands.key) - 1)
    is_policy = (commands.key[at] == states.last_command_key) & np.isclose(
        commands.kp_nm_per_rad[at, joint], facts.POLICY_KP_NM_PER_RAD
    )
    error = commands.position_rad[at, joint] - states.position_rad[:, joint]
    velocity = states.velocity_rad_s[:, joint]
    n = len(error) - max(LAGS)
    window = [signal[max(LAGS) - lag :][:n] for signal in (error, velocity) for lag in LAGS]
    torque = states.load_nm[max(LAGS) :, joint]
    rows = is_policy[:n] & is_policy[max(LAGS) :] & np.isfinite(torque) & np.isfinite(window).all(axis=0)
    return np.stack(window, axis=1)[rows], torque[rows]


def _together(parts: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    x, y = zip(*parts, strict=True)
    return np.concatenate(x), np.concatenate(y)


def _trained(x: Array, y: Array, seed: int) -> torch.nn.Module:
    torch.manual_seed(seed)
    width, layers = 32, []
    for size in (x.shape[1], width, width):
        layers += [torch.nn.Linear(size, width), torch.nn.Softsign()]
    network = torch.nn.Sequential(*layers, torch.nn.Linear(width, 1))
    inputs, wanted = _tensor(x) / SCALE, _tensor(y)[:, None] / TORQUE_NM
    optimiser = torch.optim.Adam(network.parameters(), lr=3e-3)
    order = torch.Generator().manual_seed(seed)
    for _ in range(EPOCHS):
        rows = torch.randint(len(inputs), (BATCH,), generator=order)
        loss = torch.nn.functional.mse_loss(network(inputs[rows]), wanted[rows])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    return network


def _rms(network: torch.nn.Module, x: Array, y: Array) -> float:
    with torch.no_grad():
        predicted = network(_tensor(x) / SCALE)[:, 0].numpy() * TORQUE_NM
    return float(np.sqrt(np.mean(np.square(predicted - y))))


def _tensor(values: Array) -> torch.Tensor:
    return torch.as_tensor(values, dtype=torch.float32)
