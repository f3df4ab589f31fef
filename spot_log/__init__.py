"""The log: the hand-off from the control loop, the process that writes it, and its readers.

Readers are imported on first use: the logger's process, one a run, never needs them and starts sooner.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from spot_log.errors import LogError, LogReadError

if TYPE_CHECKING:
    from spot_log.read.reader import open_run, read_run
    from spot_log.read.recover import recover_leftovers, recover_log
    from spot_log.read.run import Run

__all__ = ["LogError", "LogReadError", "Run", "open_run", "read_run", "recover_leftovers", "recover_log"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from spot_log.read import reader, recover, run

    return next(getattr(module, name) for module in (reader, recover, run) if name in vars(module))
