"""``python -m spot_model``: the same as ``spot-rl``, also where the console script is not installed."""

from spot_model.io.command_line import main

if __name__ == "__main__":
    main()
