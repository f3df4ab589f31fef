"""A process that computes without end beside a measurement; argument is the process with which it ends."""

from __future__ import annotations

import os
import sys

if __name__ == "__main__":
    while os.getppid() == int(sys.argv[1]):
        for _ in range(1_000_000):
            pass
