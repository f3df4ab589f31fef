"""spot-rl as a library: what scripts and notebooks use.

Every name is imported when it is first asked for, so ``import spot_rl`` costs nothing and needs no extra by itself; a
name whose extra is missing says which one to install. Paths may be text or :class:`pathlib.Path`. What is wrong with an
input raises :class:`SpotRlError`, whose message names the thing, what is allowed and the next step.
"""

from __future__ import annotations

import pkgutil
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from compare.compare import Comparison
    from diagnosis.document import Verdict
    from spot_log.read.run import Run
    from spot_log.tools.gaits import gaits
    from spot_model.errors import SpotRlError
    from spot_model.io.model_file import RobotModel
    from spot_model.policy.policy import Policy
    from spot_rl.environment import SpotEnv, make_env
    from spot_rl.fake_spot import FakeSpot
    from spot_rl.learning import evaluate, export, train
    from spot_rl.logs import diagnose, identify, read_run
    from spot_rl.simulation import compare, load_model, load_policy, simulate
    from trainer.sysid.result import ResultData

__all__ = [
    "Comparison",
    "FakeSpot",
    "Policy",
    "ResultData",
    "RobotModel",
    "Run",
    "SpotEnv",
    "SpotRlError",
    "Verdict",
    "compare",
    "diagnose",
    "evaluate",
    "export",
    "gaits",
    "identify",
    "load_model",
    "load_policy",
    "make_env",
    "read_run",
    "simulate",
    "train",
]

_WHERE = {
    "read_run": ("spot_rl.logs", "runtime"),
    "Run": ("spot_log.read.run", "runtime"),
    "gaits": ("spot_log.tools.gaits", "runtime"),
    "load_policy": ("spot_rl.simulation", "runtime"),
    "Policy": ("spot_model.policy.policy", "runtime"),
    "load_model": ("spot_rl.simulation", "runtime"),
    "RobotModel": ("spot_model.io.model_file", "runtime"),
    "SpotRlError": ("spot_model.errors", "runtime"),
    "FakeSpot": ("spot_rl.fake_spot", "fake"),
    "simulate": ("spot_rl.simulation", "diagnosis"),
    "compare": ("spot_rl.simulation", "diagnosis"),
    "Comparison": ("compare.compare", "diagnosis"),
    "diagnose": ("spot_rl.logs", "diagnosis"),
    "Verdict": ("diagnosis.document", "diagnosis"),
    "identify": ("spot_rl.logs", "sysid"),
    "ResultData": ("trainer.sysid.result", "sysid"),
    "make_env": ("spot_rl.environment", "gym"),
    "SpotEnv": ("spot_rl.environment", "gym"),
    "train": ("spot_rl.learning", "train"),
    "export": ("spot_rl.learning", "train"),
    "evaluate": ("spot_rl.learning", "train"),
}
"""Module of each name, and the extra that brings what it needs."""


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
