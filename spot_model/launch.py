"""Starts a module in a process of its own: ``python launch.py MODULE ARGUMENTS``.

As ``python -m`` does, but the current folder is no place to find modules: a ``json.py`` that lies there would run in a
process that knows how to log in to a robot. Python's own option for that, ``-P``, is there from 3.11 on, and leaves
what is relative in PYTHONPATH.
"""

import os
import sys


def main() -> None:
    """Run the module that the first argument names as the program of this process."""
    # In place of the folder of this file, which Python puts first.
    root = __file__.rpartition(f"{os.sep}spot_model{os.sep}")[0]
    sys.path[: 0 if getattr(sys.flags, "safe_path", False) else 1] = [root]
    from spot_model.process.python_path import leave_out_relative_entries

    del sys.path[0]
    leave_out_relative_entries()
    import runpy
    from importlib.util import find_spec

    if find_spec("spot_protos") is None:  # sources that are not installed
        sys.path.append(root)
    from spot_model.process.inherited import answer_signals, set_right

    set_right()
    answer_signals()
    del sys.argv[0]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
