"""``python -m fake_robot``: the same as ``spot-rl fake-robot``."""

from __future__ import annotations

import sys

from spot_model.command_line import main

if __name__ == "__main__":
    main(["fake-robot", *sys.argv[1:]])
