"""The log: what the loop hands over, the process that writes it, and what reads it."""

from spot_runtime.log.errors import LogError, LogReadError
from spot_runtime.log.reader import read_run
from spot_runtime.log.recover import recover_leftovers, recover_log
from spot_runtime.log.run import Run

__all__ = ["LogError", "LogReadError", "Run", "read_run", "recover_leftovers", "recover_log"]
