"""What is compared: a log from disk, or a model that is put through the first log's commands."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from compare.tracks import CompareError
from diagnosis.closed_loop.simulation import SensorNoise, simulate
from diagnosis.read import find_policy
from spot_log import Run, read_run
from spot_model.io.model_file import BUILT_IN, RobotModel, load_model
from spot_model.policy.policy import Policy
from trainer.signals.policy_ticks import script_of


def is_model(name: str) -> bool:
    """Whether a word of the command line names a model: a built-in one, or a YAML file."""
    return name in BUILT_IN or Path(name).suffix in (".yaml", ".yml")


def read_reference(path: str) -> Run:
    """The first run, which must be a log.

    Raises:
        CompareError: It names a model.
        LogReadError: It is not a log.
    """
    if is_model(path):
        raise CompareError(f"{path} is a model; the first run must be a log (*.mcap): models follow its commands")
    return read_run(Path(path))


def read_other(name: str, reference: Run, policy: Path | None, seed: int) -> Run:
    """A log, or the reference's commands on a simulated robot.

    Raises:
        CompareError: A model is named and nothing can be simulated.
        SpotRlError: A file is not valid.
    """
    if not is_model(name):
        if not Path(name).exists():
            models = ", ".join(BUILT_IN)
            raise CompareError(
                f"{name!r} is not a file; allowed: a log (*.mcap), a model file (YAML), or one of {models}"
            )
        return read_run(Path(name))
    found = find_policy(policy, [reference])
    if found is None:
        raise CompareError(
            f"{name} cannot be simulated: policies/ has no policy with the log's digest "
            f"{reference.header.policy_sha256[:12] or '(none)'}…; give the policy that ran, --policy FILE"
        )
    return simulate_like(reference, load_model(name), found, np.random.default_rng(seed))


def simulate_like(
    run: Run, model: RobotModel, policy: Policy, rng: np.random.Generator, noise: SensorNoise | None = None
) -> Run:
    """Put a model through a log's velocity commands, from the state in which the policy took over.

    Args:
        run: The log.
        model: The simulated robot.
        policy: What controls it.
        rng: Draws the noise of the sensors and the delays.
        noise: Of the sensors; a real Spot's size by default.

    Returns:
        A run in memory with the same arrays as a log's; it has no IMU packets, polls, events or footer.

    Raises:
        CompareError: The log has less than a second under a policy.
    """
    script = script_of(run)
    if script is None:
        raise CompareError(f"{run.path} has less than a second under a policy; nothing can be simulated from it")
    return simulate(model, policy, [script], rng, noise or SensorNoise())[0]
