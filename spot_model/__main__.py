"""The console script ``spot-rl``, and ``python -m spot_model``: nothing is imported before Ctrl-C is answered."""

import sys


def main() -> None:
    """Run ``spot-rl`` with the process's own arguments."""
    try:
        from spot_model.io.command_line import main as run
    except KeyboardInterrupt:
        print("spot-rl: interrupted", file=sys.stderr)  # noqa: T201 - typer is not there yet
        raise SystemExit(130) from None
    run()


if __name__ == "__main__":
    main()
