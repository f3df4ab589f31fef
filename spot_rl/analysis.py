"""Simulated runs, runs side by side, and the explanation of how they differ."""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

from compare.compare import Comparison, Named, compare_runs, named, simulate_like, write_comparison
from diagnosis.closed_loop.simulation import SensorNoise
from diagnosis.document import Verdict
from diagnosis.library.registry import chosen_library
from diagnosis.read import find_policy
from diagnosis.report.output import check_free
from diagnosis.session import Inputs, Progress, run_session
from spot_log.read.run import Run, RunFooter
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel, save_model
from spot_model.io.whole import check_new
from spot_model.policy.policy import Policy
from spot_rl.inputs import AnyPath, existing_all, load_policy, model_of, one_or_more, policy_file, to_path, whole
from trainer.simulate.engine import EngineName, place_of


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
        policy: The policy that controls; by default the one with the log's digest, built in or in ``policies/``.
        seed: Random seed of sensor noise and delays.
        noise: Whether to simulate sensor noise, about as large as a real Spot's.

    Returns:
        A run with the same arrays as a log's, for the time under the policy; it has no IMU packets, polls or events,
        and its ``outcome`` is ``simulated``.

    Raises:
        SpotRlError: The log has less than a second under a policy, or the policy is not found.
    """
    _check_run(run)
    if policy is None:
        chosen = find_policy(None, [run])
    else:
        chosen = policy if isinstance(policy, Policy) else load_policy(policy)
    if chosen is None:
        raise BadInputError(
            "neither a built-in policy nor a file in ./policies has the log's digest "
            f"{run.header.policy_sha256[:12] or '(none)'}…; give the policy that ran: simulate(run, model, policy=FILE)"
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


def diagnose(
    logs: AnyPath | Iterable[AnyPath],
    nominal: str | AnyPath | RobotModel,
    out: AnyPath,
    *,
    policy: AnyPath | Policy | None = None,
    without: Iterable[str] = (),
    add_effects: Iterable[str | type] = (),
    seed: int = 0,
    device: str = "cpu",
    progress: bool = False,
) -> Verdict:
    """Say how a robot differs from its simulator, what its own numbers are, and what both change.

    Takes about a minute for a few short logs, several for twenty of half a minute.

    Args:
        logs: Log files of one robot, or folders of them; best three command sequences, each several times.
        nominal: The simulator's model: a built-in name (``paper_identified``), a model file, or a model.
        out: Folder for verdict.json, report.html and corrected_model.yaml; nothing in it is overwritten.
        policy: The policy that ran; by default the one with the logs' digest, built in or in ``policies/``, if any.
        without: Effects to exclude from the library.
        add_effects: Effects of your own: each a class, or ``module:Class``.
        seed: Random seed.
        device: What simulates: "cpu", or "cuda" for an NVIDIA GPU (extra ``gpu``).
        progress: Whether to show stage, share and time left on stderr.

    Returns:
        The verdict: ``status``, ``headline``, ``differences`` (effects that the logs show: name, joints, probability,
        parameters, consequences), ``calibration`` (the robot's own numbers), ``consequences``, ``remainder``.

    Raises:
        SpotRlError: A file is missing or not valid, or ``out`` holds a diagnosis.
    """
    folder = to_path(out, "out")
    paths = existing_all(logs, "logs")
    model, name = model_of(nominal)
    added: list[str | type] = one_or_more(add_effects, "add_effects")
    left_out: list[str] = one_or_more(without, "without")
    library = chosen_library(added, left_out)
    check_free(folder)
    kept = (folder / "nominal.yaml").absolute() if isinstance(nominal, RobotModel) else None
    if kept is not None:
        check_new(kept)
    inputs = Inputs(
        logs=tuple(map(str, paths)),
        nominal=name if kept is None else str(kept),
        policy=str(policy_file(policy)) if policy is not None else None,
        add_effect=tuple(e if isinstance(e, str) else f"{e.__module__}:{e.__qualname__}" for e in added),
        without=tuple(left_out),
    )
    with Progress(None if progress else Console(file=io.StringIO())) as say:
        result, _ = run_session(
            inputs,
            folder,
            say,
            nominal=model,
            library=library,
            place=place_of(1, EngineName.LOCAL, None, device),
            seed=whole(seed, "seed"),
        )
    if kept is not None:
        save_model(model, kept)
    return result.verdict


def _check_run(run: object) -> None:
    if not isinstance(run, Run):
        raise BadInputError(f"{run!r:.60} is no run; read a log first: run = spot_rl.read_run(PATH)")
