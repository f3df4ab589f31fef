"""Simulated runs, runs side by side, and the explanation of how they differ."""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from compare.compare import FILES, Comparison, Named, compare_runs, named, simulate_like, write_comparison
from compare.diagnose_command import FOLDER, compared
from diagnosis.document import Verdict
from diagnosis.library.registry import chosen_library
from diagnosis.read import find_policy
from diagnosis.read.fixed_base import Drives, predicted
from diagnosis.read.prepare import with_own_gains
from diagnosis.read.robot_file import load_robot
from diagnosis.report.output import check_no_diagnosis
from diagnosis.session import DiagnosisProgress, DiagnosisRequest, run_session
from spot_log.read.run import Run, RunFooter
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel, save_model
from spot_model.io.whole import check_new
from spot_model.policy.policy import Policy
from spot_rl.checks import (
    AnyPath,
    a_folder,
    a_run,
    existing_all,
    flag,
    one_or_more,
    text,
    whole,
    with_our_errors,
    wrong,
)
from spot_rl.inputs import model_of, policy_file, policy_of
from trainer.simulate.engine import EngineName, place_of
from trainer.simulate.recorded_runs import UsualNoise


@with_our_errors
def predict(robot: AnyPath, run: Run, *, restart_s: float | None = None) -> NDArray[np.float64]:
    """Predict how another robot than Spot, on a fixed base, moves under a log's commands.

    Args:
        robot: A robot file with an MJCF, such as the ``corrected_robot.yaml`` of a diagnosis.
        run: Has the commands, and the state to begin with, from :func:`read_run`.
        restart_s: Start anew from the measured state after so long; by default never.

    Returns:
        Positions at the log's states, rad, shape (n, J).
    """
    file = load_robot(Path(robot))
    if file.mjcf is None:
        raise wrong("robot", str(robot), "a robot file with the key mjcf, the rigid bodies")
    return predicted(file, with_own_gains(run, file), Drives.of(file), restart_s)


@with_our_errors
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
    a_run(run)
    seed, noise = whole(seed, "seed"), flag(noise, "noise")
    chosen = find_policy(None, [run]) if policy is None else policy_of(policy)
    if chosen is None:
        raise BadInputError(
            "neither a built-in policy nor a file in ./policies has the log's digest "
            f"{run.header.policy_sha256[:12] or '(none)'}…; give the policy that ran: simulate(run, model, policy=FILE)"
        )
    sensors = UsualNoise() if noise else UsualNoise(0.0, 0.0, 0.0, 0.0, 0.0)
    simulated, name = model_of(model)
    made = simulate_like(run, simulated, chosen, np.random.default_rng(seed), sensors)
    # A comparison names its runs by their paths.
    footer = RunFooter(host_stamp_ns=0, messages={}, dropped={}, outcome="simulated")
    return dataclasses.replace(made, path=Path(f"simulated-{Path(name).stem}"), footer=footer)


@with_our_errors
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
    given: object = runs
    if not isinstance(given, (list, tuple)):
        raise wrong("runs", runs, "a list of two runs or more")
    for number, run in enumerate(runs):
        a_run(run, f"runs[{number}]")
    if names is not None:
        given_names: list[str] = one_or_more(names, "names")
        told = [text(name, "names") for name in given_names]
        if len(told) != len(runs) or len(set(told)) < len(told):
            raise wrong("names", names, f"a list of {len(runs)} different texts, one a run")
    folder = None if out is None else a_folder(out, "out")
    if folder is not None:
        check_new(*(folder / name for name in FILES))
    simulated = [str(run.path).startswith("simulated-") for run in runs]
    if names is not None:
        chosen = [Named(name, run, is_it) for name, run, is_it in zip(names, runs, simulated, strict=True)]
    else:
        chosen = named([Named(str(run.path), run, is_it) for run, is_it in zip(runs, simulated, strict=True)])
    found = compare_runs(chosen)
    if folder is not None:
        write_comparison(found, folder)
    return found


@with_our_errors
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
        out: Folder for what ``spot-rl diagnose`` writes: report.html, verdict.json, corrected_model.yaml, compare/ (a
            log beside the models) and the rest; nothing in it is overwritten.
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
    folder = a_folder(out, "out")
    paths = existing_all(logs, "logs")
    model, name = model_of(nominal)
    added: list[str | type] = one_or_more(add_effects, "add_effects")
    excluded: list[str] = one_or_more(without, "without")
    left_out = [text(effect, "without") for effect in excluded]
    library = chosen_library(added, left_out)
    seed, progress = whole(seed, "seed"), flag(progress, "progress")
    place = place_of(1, EngineName.LOCAL, None, text(device, "device", "cpu, cuda or cuda:N"))
    check_no_diagnosis(folder)
    check_new(folder / FOLDER)
    kept = (folder / "nominal.yaml").absolute() if isinstance(nominal, RobotModel) else None
    if kept is not None:
        check_new(kept)
    inputs = DiagnosisRequest(
        logs=tuple(map(str, paths)),
        nominal=name if kept is None else str(kept),
        policy=str(policy_file(policy)) if policy is not None else None,
        add_effect=tuple(e if isinstance(e, str) else f"{e.__module__}:{e.__qualname__}" for e in added),
        without=tuple(left_out),
    )
    with DiagnosisProgress(None if progress else Console(file=io.StringIO())) as say:
        result, _ = run_session(inputs, folder, say, nominal=model, library=library, place=place, seed=seed)
    if kept is not None:
        save_model(model, kept)
    compared(result, folder)
    return result.verdict
