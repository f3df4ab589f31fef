"""Runs ``spot-rl`` command lines in turn, each in a fork of this one process, which has the heavy libraries in memory.

    python one_by_one.py < LINES    # JSON: a list of lists of words; ends with the first exit code that is not 0

A word with an ellipsis, as runs/walk-…, stands for the one path here that it fits.
"""

from __future__ import annotations

import json
import os
import shlex
import sys
from pathlib import Path

# What each of the commands would import for itself, for two seconds of CPU time.
import mujoco.batch
import onnxruntime
import rsl_rl.runners
import scipy.stats
import torch

from spot_model.console.command_line import main

LIBRARIES = (mujoco.batch, onnxruntime, rsl_rl.runners, scipy.stats, torch)


def run(words: list[str]) -> int:
    """The command's exit code; what it prints goes where ours would."""
    sys.stdout.write(f"$ {shlex.join(words)}\n")
    sys.stdout.flush()
    process = os.fork()
    if process == 0:
        code: object = 70
        try:
            main(words[1:])
        except SystemExit as end:
            code = end.code
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code if isinstance(code, int) else int(code is not None))
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def named(word: str) -> str:
    """The word, or the path that it means."""
    return str(next(Path().glob(word.replace("…", "*")))) if "…" in word else word


if __name__ == "__main__":
    for line in json.load(sys.stdin):
        if failed := run([named(word) for word in line]):
            sys.exit(failed)
