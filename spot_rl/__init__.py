"""spot-rl as a library: what scripts and notebooks use.

Every name is imported when it is first asked for, so ``import spot_rl`` costs nothing and needs no extra by itself; a
name whose extra is missing says which one to install. Paths may be text or :class:`pathlib.Path`. What is wrong with an
input raises :class:`SpotRlError`, whose message names the thing, what is allowed and the next step.
"""

from __future__ import annotations

import pkgutil
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from compare.compare import Comparison as Comparison
    from diagnosis.document import Verdict as Verdict
    from spot_log.read.run import Run as Run
    from spot_model.errors import SpotRlError as SpotRlError
    from spot_model.io.model_file import RobotModel as RobotModel
    from spot_model.policy.policy import Policy as Policy
    from spot_rl.analysis import compare as compare
    from spot_rl.analysis import diagnose as diagnose
    from spot_rl.analysis import predict as predict
    from spot_rl.analysis import simulate as simulate
    from spot_rl.environment import SpotEnv as SpotEnv
    from spot_rl.environment import make_env as make_env
    from spot_rl.fake_spot import FakeSpot as FakeSpot
    from spot_rl.inputs import gaits as gaits
    from spot_rl.inputs import load_model as load_model
    from spot_rl.inputs import load_policy as load_policy
    from spot_rl.inputs import read_run as read_run
    from spot_rl.learning import evaluate as evaluate
    from spot_rl.learning import export as export
    from spot_rl.learning import identify as identify
    from spot_rl.learning import train as train
    from spot_rl.vector_environment import SpotVectorEnv as SpotVectorEnv
    from spot_rl.vector_environment import make_vec_env as make_vec_env
    from trainer.sysid.result import ResultData as ResultData

_WHERE = {
    "read_run": ("spot_rl.inputs", "runtime"),
    "Run": ("spot_log.read.run", "runtime"),
    "gaits": ("spot_rl.inputs", "runtime"),
    "load_policy": ("spot_rl.inputs", "runtime"),
    "Policy": ("spot_model.policy.policy", "runtime"),
    "load_model": ("spot_rl.inputs", "runtime"),
    "RobotModel": ("spot_model.io.model_file", "runtime"),
    "SpotRlError": ("spot_model.errors", "runtime"),
    "FakeSpot": ("spot_rl.fake_spot", "fake"),
    "simulate": ("spot_rl.analysis", "diagnosis"),
    "compare": ("spot_rl.analysis", "diagnosis"),
    "Comparison": ("compare.compare", "diagnosis"),
    "diagnose": ("spot_rl.analysis", "diagnosis"),
    "predict": ("spot_rl.analysis", "diagnosis"),
    "Verdict": ("diagnosis.document", "diagnosis"),
    "identify": ("spot_rl.learning", "sysid"),
    "ResultData": ("trainer.sysid.result", "sysid"),
    "make_env": ("spot_rl.environment", "gym"),
    "SpotEnv": ("spot_rl.environment", "gym"),
    "make_vec_env": ("spot_rl.vector_environment", "gym"),
    "SpotVectorEnv": ("spot_rl.vector_environment", "gym"),
    "train": ("spot_rl.learning", "train"),
    "export": ("spot_rl.learning", "train"),
    "evaluate": ("spot_rl.learning", "train"),
}
"""Module of each name, and the extra that brings what it needs."""

__all__ = sorted(_WHERE)  # noqa: PLE0605 - one list of names, not two


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it has {', '.join(__all__)}")
    module, extra = _WHERE[name]
    try:
        return pkgutil.resolve_name(f"{module}:{name}")
    except ModuleNotFoundError as error:
        raise ImportError(
            f"spot_rl.{name} needs the module {error.name!r}, which is not installed; "
            f"install the extra {extra!r}: pip install 'spot-rl[{extra}]'"
        ) from error


def __dir__() -> list[str]:
    return list(__all__)
