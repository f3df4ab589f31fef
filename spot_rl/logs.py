"""Logs in Python: read them, explain them, fit a simulator to them."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from spot_rl.paths import AnyPath, existing, existing_all, one_or_more, to_path, whole

if TYPE_CHECKING:
    from diagnosis.document import Verdict
    from spot_log.read.run import Run
    from spot_model.io.model_file import RobotModel
    from spot_model.policy.policy import Policy
    from trainer.sysid.config import SysidConfig
    from trainer.sysid.result import ResultData


def read_run(path: AnyPath) -> Run:
    """Read one log into NumPy arrays.

    A log that was cut short or damaged is read as far as it goes; ``run.damage`` says what is missing.

    Args:
        path: A ``*.mcap`` file, or the ``*.mcap.active`` of a crash.

    Returns:
        The run: ``header``, ``states``, ``commands``, ``ticks``, ``slow_states``, ``events``, ``outcome``, and
        ``run.to_pandas("state")`` for a data frame. Joints are in the order ``run.header.joint_names``.

    Raises:
        SpotRlError: The file is not there, or is no log.
    """
    from spot_log.read.reader import read_run as read

    return read(existing(path, "log"))


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
        policy: The policy that ran; by default the file in ``policies/`` with the logs' digest, if there is one.
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
    from rich.console import Console

    from diagnosis.library.registry import chosen_library
    from diagnosis.report.output import check_free
    from diagnosis.session import Inputs, Progress, run_session
    from spot_model.io.model_file import RobotModel, save_model
    from spot_model.io.whole import check_new
    from spot_rl.simulation import model_of, policy_file
    from trainer.simulate.engine import EngineName, place_of

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
        device: What simulates: "cpu", or "cuda" for an NVIDIA GPU (extra ``gpu``), which one process fills.

    Returns:
        The result: ``parameters`` (name, value, low, high, identified, reason), ``score``, ``measured``.

    Raises:
        SpotRlError: A file is missing or not valid, ``out`` holds a result, or no log can be used.
    """
    from multiprocessing import current_process

    from spot_model.errors import BadInputError
    from spot_model.policy.policy import load_policy
    from spot_rl.simulation import policy_file
    from trainer.simulate.engine import EngineName, place_of
    from trainer.sysid.logs import read_logs
    from trainer.sysid.run_identification import run_identification

    # As multiprocessing itself asks: a worker that still imports the script must start no workers.
    if getattr(current_process(), "_inheriting", False):
        raise BadInputError(
            "identify: its worker processes import your script, which ran again: put the script's own lines under "
            'if __name__ == "__main__":, or give workers=1'
        )
    settings = _sysid_config(config, generations)
    file = policy_file(policy)
    log_set = read_logs(existing_all(logs, "logs"), load_policy(file))
    place = place_of(workers, EngineName.LOCAL, None, device)
    return run_identification(log_set, file, settings, to_path(out, "out"), resume=resume, place=place)


def _sysid_config(config: AnyPath | Mapping[str, Any] | None, generations: int | None) -> SysidConfig:
    from spot_model.errors import BadInputError
    from trainer.sysid.config import SysidConfig, config_from_data, load_config

    if config is None:
        settings = SysidConfig()
    elif isinstance(config, Mapping):
        settings = config_from_data(dict(config), source="config")
    else:
        settings = load_config(existing(config, "config"))
    if generations is None:
        return settings
    if generations < 1:
        raise BadInputError(f"generations = {generations}; allowed: 1 or more")
    return settings.model_copy(update={"search": settings.search.model_copy(update={"generations": generations})})
