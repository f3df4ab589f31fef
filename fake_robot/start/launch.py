"""The fake robot with the rights of a robot's computer: it must not compete with what it is driven by.

Arguments: real-time priority (0 for none), CPUs with commas between them (empty for all), then those of ``spot-rl``.
"""

from __future__ import annotations

import contextlib
import os
import sys

from spot_model.io.command_line import main

if __name__ == "__main__":
    priority, stay, *words = sys.argv[1:]
    if stay:
        os.sched_setaffinity(0, [int(cpu) for cpu in stay.split(",")])
    if int(priority):
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(int(priority)))
    main(words)
