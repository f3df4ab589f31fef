from __future__ import annotations

import signal
import subprocess
from pathlib import Path

from proof.faults.rows_process import Running
from spot_model.process.child_process import ChildProcess


def running(program: str) -> Running:
    process = subprocess.Popen(["sh", "-c", program], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    return Running(ChildProcess(process), Path())


def test_what_hangs_is_killed_and_said() -> None:
    assert running("echo waiting >&2; exec sleep 600").finish(0.5) == (-signal.SIGKILL, "waiting\n", True)


def test_what_ends_by_itself_is_left_alone() -> None:
    assert running("echo done >&2; exit 3").finish() == (3, "done\n", False)
