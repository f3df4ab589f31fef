"""Training, export and evaluation of policies, and the fit of a simulator to logs.

What brings torch, or needs the extra of one function alone, is imported there.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from datetime import datetime, timezone
from multiprocessing import current_process
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy
from spot_rl.checks import (
    AnyPath,
    a_file,
    a_folder,
    existing,
    existing_all,
    flag,
    mapping,
    new_file,
    text,
    whole,
    with_our_errors,
    wrong,
)
from spot_rl.config import training_config
from spot_rl.inputs import model_of, policy_file, policy_of

if TYPE_CHECKING:
    import torch

    from spot_rl.environment import SpotEnv
    from spot_rl.vector_environment import SpotVectorEnv
    from trainer.sysid.config import SysidConfig
    from trainer.sysid.result import ResultData

DEVICES = "cpu, cuda or cuda:N"
MOST_WORKERS = 1024


@with_our_errors
def train(
    config: AnyPath | Mapping[str, Any],
    out: AnyPath | None = None,
    *,
    changes: Mapping[str, Any] | None = None,
    device: str = "cpu",
) -> Path:
    """Train a policy with PPO.

    Args:
        config: A config file (YAML), or the same keys as a mapping.
        out: Run folder, empty or new; ``runs/NAME-TIME`` by default.
        changes: Keys of the config to change, such as ``{"iterations": 2, "rewards.gait": 10.0}``.
        device: ``cpu``, ``cuda`` or ``cuda:N``.

    Returns:
        The run folder, for :func:`export`.

    Raises:
        SpotRlError: The config is not valid (the message lists the allowed keys), the folder is not empty, or the
            device does not exist.
    """
    # Spinning threads take the cores from the physics; torch reads this when it is first imported.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    settings = training_config(config, changes)
    device = text(device, "device", DEVICES)
    stamp = datetime.now(tz=timezone.utc).strftime("%Y%m%d-%H%M%S")
    folder = a_folder(out, "out") if out is not None else Path("runs") / f"{settings.name}-{stamp}"
    from trainer.ppo.train import train_policy as run_training

    run_training(settings, folder, device=device, command="spot_rl.train")
    return folder


@with_our_errors
def export(
    run: AnyPath | torch.nn.Module, out: AnyPath, *, name: str | None = None, env: SpotEnv | SpotVectorEnv | None = None
) -> Path:
    """Write a trained policy as an ONNX file with its contract.

    Args:
        run: A run folder, a checkpoint, or a network that another library trained: a ``torch.nn.Module`` of linear
            layers with ELU between them, from the 48 observations to the 12 actions. Of rsl_rl, give the whole actor:
            its normaliser goes into the file.
        out: The file to write; never overwritten.
        name: The policy's name; the config's by default.
        env: With a network: the environment it was trained in, which says what its actions mean.

    Returns:
        The file.

    Raises:
        SpotRlError: There is no checkpoint, the network is of another kind, or the file exists.
    """
    import torch

    from trainer.evaluate.export import export_network, export_policy

    name = None if name is None else text(name, "name")
    place = new_file(out, "out")
    if not isinstance(run, torch.nn.Module):
        if env is not None:
            raise wrong("env", env, "None, where run is a folder or a checkpoint")
        export_policy(existing(run, "run"), place, name)
        return place
    from spot_rl.environment import SpotEnv
    from spot_rl.episodes import action_unit
    from spot_rl.vector_environment import SpotVectorEnv

    trained_in = getattr(env, "unwrapped", None)
    if not isinstance(trained_in, (SpotEnv, SpotVectorEnv)):
        raise wrong("env", env, "the environment that the network was trained in, of make_env or make_vec_env")
    config = trained_in.config
    model = trained_in.model or model_of(config.model)[0]
    unit = action_unit(trained_in.action_space)
    export_network(run, config, model, place, name or config.name, unit)
    return place


@with_our_errors
def evaluate(
    policy: AnyPath | Policy, *, model: str | AnyPath | RobotModel = "paper_identified", n: int = 100, seed: int = 0
) -> dict[str, Any]:
    """Measure a policy in simulation: tracking, top speed, gait, falls, pushes, a slippery patch.

    Args:
        policy: An ONNX file, or a policy of :func:`load_policy`.
        model: The simulated robot: a built-in name, a model file, or a model.
        n: Robots in each trial that counts falls; 100 take some minutes on two cores.
        seed: Random seed.

    Returns:
        Figures by trial, as in the ``evaluation.json`` of ``spot-rl evaluate``; speeds in m/s, power in W.
        ``tracking``, single commands on flat ground: ``mean_forward_error_m_s``, ``mean_lateral_error_m_s``,
        ``mean_yaw_error_rad_s``, ``standing_speed_m_s``. ``top_speed``: ``sustained_m_s`` (None if it falls at every
        speed), ``commanded_m_s``, ``power_w``, ``gait``, ``stride_hz``, ``curve`` (commanded, held, upright).
        ``episodes_slow`` (up to 3 m/s) and, for faster policies, ``episodes_fast``: ``falls`` of ``episodes`` of 20 s.
        These have random friction (0.3 to 1.0, times the scale of an effect ``ground_friction``), masses, starts and
        pushes.
        ``pushes`` of 1 m/s and ``slippery_patch``: ``survived`` of ``trials``.

    Raises:
        SpotRlError: A file is missing or not valid.
    """
    from trainer.evaluate.setting import Setting
    from trainer.evaluate.trials import evaluate_setting as run_trials

    n, seed = whole(n, "n", 1), whole(seed, "seed")
    return run_trials(Setting(policy=policy_of(policy), model=model_of(model)[0], seed=seed), n=n)


@with_our_errors
def identify(
    logs: AnyPath | Iterable[AnyPath],
    policy: AnyPath | Policy,
    out: AnyPath,
    *,
    config: AnyPath | Mapping[str, Any] | None = None,
    generations: int | None = None,
    workers: int = 2,
    resume: bool = False,
    device: str = "cpu",
) -> ResultData:
    """Fit physical parameters of the simulator to logs, by the paper's method and from measured torques.

    A hundred generations take about seven minutes on two cores; one is enough for parameters that torques determine.

    Args:
        logs: Log files of one policy, or folders of them; each has at least five seconds under it.
        policy: The policy that ran: an ONNX file, or a policy of :func:`load_policy`.
        out: Folder for identified.yaml, result.json and report.html; nothing in it is overwritten.
        config: Parameters and settings of the search: a YAML file, or its keys as a mapping ([all
            keys](files.md#search-of-an-identification)), such as ``{"parameters": [{"effect": "coulomb_friction",
            "joints": ["knees"], "parameter": "level_nm", "initial": 0.0, "low": 0.0, "high": 1.5}]}``. Default: the
            paper's.
        generations: Generations of the search, in place of the config's.
        workers: Processes, which import the script that calls this: put its own lines under
            ``if __name__ == "__main__":``, or give 1. The result does not depend on them.
        resume: Continue an interrupted search in ``out``.
        device: Where to simulate: "cpu", or "cuda" for an NVIDIA GPU (extra ``gpu``), for which one process is enough.

    Returns:
        The result: ``parameters`` (name, value, low, high, identified, reason), ``score``, ``measured``.

    Raises:
        SpotRlError: A file is missing or not valid, ``out`` holds a result, or no log can be used.
    """
    from trainer.simulate.engine import EngineName, place_of
    from trainer.sysid.logs import read_identification_logs
    from trainer.sysid.run_identification import run_identification

    # As multiprocessing itself asks: a worker that still imports the script must start no workers.
    if getattr(current_process(), "_inheriting", False):
        raise BadInputError(
            "identify: its worker processes import your script, which ran again: put the script's own lines under "
            'if __name__ == "__main__":, or give workers=1'
        )
    settings = _sysid_config(config, generations)
    workers, device = whole(workers, "workers", 1, MOST_WORKERS), text(device, "device", DEVICES)
    folder, resume = a_folder(out, "out"), flag(resume, "resume")
    place = place_of(workers, EngineName.LOCAL, None, device)
    file = policy_file(policy)
    log_set = read_identification_logs(existing_all(logs, "logs"), policy_of(file))
    return run_identification(log_set, file, settings, folder, resume=resume, place=place)


def _sysid_config(config: AnyPath | Mapping[str, Any] | None, generations: int | None) -> SysidConfig:
    from trainer.sysid.config import SysidConfig, load_sysid_config, sysid_config_from_data

    if config is None:
        settings = SysidConfig()
    elif isinstance(config, Mapping):
        settings = sysid_config_from_data(mapping(config, "config", "a mapping of keys"), source="config")
    else:
        settings = load_sysid_config(a_file(config, "config"))
    if generations is None:
        return settings
    generations = whole(generations, "generations", 1)
    return settings.model_copy(update={"search": settings.search.model_copy(update={"generations": generations})})
