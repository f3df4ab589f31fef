"""The console script ``spot-rl``, and ``python -m spot_model``: nothing is imported before Ctrl-C is answered."""

import os
import sys


def leave_out_current_folder() -> None:
    """Find no module in the current folder, which ``python -m`` puts first, unless this package lies there."""
    is_by_module = sys.orig_argv[len(sys.orig_argv) - len(sys.argv) - 1] == "-m"
    if is_by_module and not getattr(sys.flags, "safe_path", False):  # a flag that Python has from 3.11 on
        root = __file__.rpartition(f"{os.sep}spot_model{os.sep}")[0]
        if sys.path[0] not in (root, os.path.realpath(root)):
            del sys.path[0]


def main() -> None:
    """Run ``spot-rl`` with the process's own arguments."""
    if os.environ.pop("PYTHONINSPECT", ""):  # with it, the exit would be a traceback and a prompt
        os.execv(sys.executable, sys.orig_argv)  # noqa: S606 - the words that started this process
    try:
        from spot_model.process.python_path import leave_out_relative_entries

        command = next((word for word in sys.argv[1:] if not word.startswith("-")), "")
        for entry, full in leave_out_relative_entries(command).items():
            sys.stderr.write(f"spot-rl: warning: PYTHONPATH: {entry!r} is left out; write it in full: {full!r}\n")
        from spot_model.process.inherited import set_right

        set_right()
        if sys.flags.optimize > 1:
            sys.stderr.write("spot-rl: error: the vendor's SDK fails with PYTHONOPTIMIZE=2 (-OO); unset it\n")
            raise SystemExit(2)
        from spot_model.console.command_line import main as run
    except KeyboardInterrupt:
        print("spot-rl: interrupted", file=sys.stderr)  # noqa: T201 - typer is not there yet
        raise SystemExit(130) from None
    run()


if __name__ == "__main__":
    leave_out_current_folder()
    main()
