"""Starts a module in a process of its own: ``python launch.py MODULE ARGUMENTS``.

As ``python -m`` does, but the current folder is no place to find modules: a ``json.py`` that lies there would run in a
process that knows how to log in to a robot. Python's own option for that, ``-P``, is there from 3.11 on.
"""

import sys


def main() -> None:
    """Run the module that the first argument names as the program of this process."""
    # The folder of this file, which Python puts first.
    if not getattr(sys.flags, "safe_path", False):
        del sys.path[0]
    import runpy
    from importlib.util import find_spec
    from pathlib import Path

    if find_spec("spot_model") is None:  # sources that are not installed
        sys.path.append(str(Path(__file__).absolute().parents[1]))
    from spot_model.process.inherited import answer_signals, set_right

    set_right()
    answer_signals()
    del sys.argv[0]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
