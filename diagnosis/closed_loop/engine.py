"""Where closed-loop runs are computed: in this process, or on a Ray cluster. The numbers are the same bits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from typing_extensions import Self

from diagnosis.closed_loop.simulation import SensorNoise, simulate
from spot_log.read.run import Run
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy, policy_from_bytes
from trainer.shared.ray_cluster import RayCluster
from trainer.signals.policy_ticks import Script

Tell = Callable[[float], None]
"""Called now and then with the share that is done."""


@dataclass(frozen=True)
class Rollout:
    """One batch of closed-loop runs of one model; its numbers depend on nothing else."""

    model: RobotModel
    scripts: tuple[Script, ...]
    seed: int
    only_ticks: bool = False
    """No states between the policy's ticks."""


class Engine(Protocol):
    """Computes rollouts; used as a context manager."""

    def simulate(self, rollouts: Sequence[Rollout], tell: Tell) -> list[list[Run]]:
        """Runs of each rollout, in their order.

        Raises:
            BadInputError: A model cannot be simulated.
        """
        ...

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        return None


class LocalEngine(Engine):
    """Computes one rollout after the other in this process."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy

    def simulate(self, rollouts: Sequence[Rollout], tell: Tell) -> list[list[Run]]:
        """Runs of each rollout."""
        out = []
        for i, rollout in enumerate(rollouts):

            def part(share: float, i: int = i) -> None:
                tell((i + share) / len(rollouts))

            out.append(run_rollout(rollout, self._policy, part))
        return out


class RayEngine(Engine):
    """Computes each rollout as a task of a Ray cluster (the extra ``ray``): the running one, or one on this machine.

    Args:
        policy: The policy file's content.
        address: Of a running cluster.
    """

    def __init__(self, policy: bytes, address: str | None = None) -> None:
        self._cluster = RayCluster(address)
        self._ray = self._cluster.ray
        self._policy = policy
        self._shared: Any = None
        self._task: Any = None

    def __enter__(self) -> Self:
        self._cluster.join()
        self._shared = self._ray.put(self._policy)
        self._task = self._ray.remote(num_cpus=1)(_remote)
        return self

    def __exit__(self, *_: object) -> None:
        self._cluster.leave()

    def simulate(self, rollouts: Sequence[Rollout], tell: Tell) -> list[list[Run]]:
        """Runs of each rollout."""
        waiting = [self._task.remote(self._shared, r) for r in rollouts]
        left, n = list(waiting), len(waiting)
        while left:
            _, left = self._ray.wait(left, num_returns=1)
            tell(1.0 - len(left) / n)
        found: list[list[Run] | BadInputError] = self._ray.get(waiting)
        runs: list[list[Run]] = []
        for each in found:
            if isinstance(each, BadInputError):
                raise each
            runs.append(each)
        return runs


def run_rollout(rollout: Rollout, policy: Policy, tell: Tell) -> list[Run]:
    """One rollout, here."""
    rng = np.random.default_rng(rollout.seed)
    return simulate(
        rollout.model, policy, rollout.scripts, rng, SensorNoise(), tell=tell, only_ticks=rollout.only_ticks
    )


def _remote(policy: bytes, rollout: Rollout) -> list[Run] | BadInputError:
    try:
        return run_rollout(rollout, policy_from_bytes(policy, source="of the cluster"), lambda _: None)
    except BadInputError as error:
        return error
