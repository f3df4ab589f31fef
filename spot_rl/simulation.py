"""Models, policies, simulated runs, and runs side by side."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spot_rl.paths import AnyPath, existing, to_path, whole

if TYPE_CHECKING:
    from compare.compare import Comparison
    from spot_log.read.run import Run
    from spot_model.effects.base import Effect
    from spot_model.io.model_file import RobotModel
    from spot_model.policy.policy import Policy


def load_policy(path: AnyPath) -> Policy:
    """Load a policy from its ONNX file, and check its contract.

    Args:
        path: A file of ``spot-rl export``, or one from ``policies/``.

    Returns:
        The policy: ``policy.contract`` says rate, gains, command range and training; ``policy.act(observation)``
        gives the action for an observation of shape (48,) or (n, 48).

    Raises:
        SpotRlError: The file is not there, is no ONNX model, or its contract does not hold.
    """
    from spot_model.policy.policy import load_policy as load

    return load(existing(path, "policy"))


def policy_file(policy: AnyPath | Policy) -> Path:
    """The file of a policy that was given as a path, or as :func:`load_policy` returned it."""
    from spot_model.errors import BadInputError
    from spot_model.policy.policy import Policy

    if not isinstance(policy, Policy):
        return existing(policy, "policy")
    if policy.path is None:
        raise BadInputError(f"policy {policy.contract.name} was not loaded from a file; give the path of its ONNX file")
    return existing(policy.path, "policy")


def load_model(name_or_path: AnyPath, *, effects: Sequence[Mapping[str, Any] | Effect] = ()) -> RobotModel:
    """Load the model of a simulated Spot: the effects that act in it.

    Args:
        name_or_path: ``ideal``, ``paper_initial``, ``paper_identified``, or a model file (YAML).
        effects: More effects, each as the keys of a model file, such as
            ``{"effect": "coulomb_friction", "joints": ["knees"], "level_nm": 5.0}``, or as an object of an effect's
            class, such as your own.

    Returns:
        The model; ``model.effects`` are those that act in it.

    Raises:
        SpotRlError: There is no such model or effect, or a key or value is not allowed.
    """
    from spot_model.effects.base import Effect
    from spot_model.io.model_file import load_model as load
    from spot_model.io.model_file import model_from_data

    model = load(str(to_path(name_or_path, "model")))
    for effect in effects:
        made = [effect] if isinstance(effect, Effect) else model_from_data({"effects": [effect]}).effects
        model = model.with_effects(*made)
    return model


def model_of(given: str | AnyPath | RobotModel) -> tuple[RobotModel, str]:
    """A model and its name, from a model, a built-in name or a file."""
    from spot_model.io.model_file import RobotModel

    if isinstance(given, RobotModel):
        return given, "model"
    return load_model(given), os.fspath(given)


def simulate(
    run: Run,
    model: str | AnyPath | RobotModel,
    *,
    policy: AnyPath | Policy | None = None,
    seed: int = 0,
    noise: bool = True,
) -> Run:
    """Simulate a log's velocity commands: the same start, the same commands, the policy in closed loop.

    Args:
        run: A log, from :func:`read_run`.
        model: The simulated robot: a built-in name, a model file, or a model.
        policy: The policy that controls; by default the file in ``policies/`` with the log's digest.
        seed: Random seed of sensor noise and delays.
        noise: Whether to simulate sensor noise, about as large as a real Spot's.

    Returns:
        A run with the same arrays as a log's, for the time under the policy; it has no IMU packets, polls or events,
        and its ``outcome`` is ``simulated``.

    Raises:
        SpotRlError: The log has less than a second under a policy, or the policy is not found.
    """
    import numpy as np

    from compare.sources import simulate_like
    from diagnosis.closed_loop.simulation import SensorNoise
    from diagnosis.read import find_policy
    from spot_log.read.run import RunFooter
    from spot_model.errors import BadInputError
    from spot_model.policy.policy import Policy

    _check_run(run)
    if policy is None:
        chosen = find_policy(None, [run])
    else:
        chosen = policy if isinstance(policy, Policy) else load_policy(policy)
    if chosen is None:
        raise BadInputError(
            f"policies/ has no policy with the log's digest {run.header.policy_sha256[:12] or '(none)'}…; "
            "give the policy that ran: simulate(run, model, policy=FILE)"
        )
    sensors = SensorNoise() if noise else SensorNoise(0.0, 0.0, 0.0, 0.0, 0.0)
    simulated, name = model_of(model)
    made = simulate_like(run, simulated, chosen, np.random.default_rng(whole(seed, "seed")), sensors)
    # A comparison names its runs by their paths.
    footer = RunFooter(host_stamp_ns=0, messages={}, dropped={}, outcome="simulated")
    return dataclasses.replace(made, path=Path(f"simulated-{Path(name).stem}"), footer=footer)


def compare(runs: Sequence[Run], out: AnyPath | None = None, *, names: Sequence[str] | None = None) -> Comparison:
    """Compare runs, aligned by their velocity commands.

    Args:
        runs: Two or more; the first is the reference.
        out: Folder for compare.html, compare.mcap (a ghost Spot beside the robot, for Foxglove) and compare.json;
            nothing is overwritten. Default: nothing is written.
        names: Names of the runs; by default their policy, sequence and repeat.

    Returns:
        The comparison: ``sentences``, ``tracks`` (aligned arrays) and ``differences`` by signal and joint.

    Raises:
        SpotRlError: There are fewer than two runs, they follow different commands, or ``out`` holds a comparison.
    """
    from compare.compare import Named, compare_runs, named, write_comparison
    from spot_model.errors import BadInputError

    for run in runs:
        _check_run(run)
    if names is not None and len(names) != len(runs):
        raise BadInputError(f"{len(names)} names for {len(runs)} runs; give one name a run")
    if names is not None and (len(set(names)) < len(names) or not all(isinstance(name, str) for name in names)):
        raise BadInputError(f"names = {list(names)!r:.80}; allowed: texts, each another one")
    simulated = [str(run.path).startswith("simulated-") for run in runs]
    if names is not None:
        chosen = [Named(name, run, is_it) for name, run, is_it in zip(names, runs, simulated, strict=True)]
    else:
        chosen = named([Named(str(run.path), run, is_it) for run, is_it in zip(runs, simulated, strict=True)])
    found = compare_runs(chosen)
    if out is not None:
        write_comparison(found, to_path(out, "out"))
    return found


def _check_run(run: object) -> None:
    from spot_log.read.run import Run
    from spot_model.errors import BadInputError

    if not isinstance(run, Run):
        raise BadInputError(f"{run!r:.60} is no run; read a log first: run = spot_rl.read_run(PATH)")
