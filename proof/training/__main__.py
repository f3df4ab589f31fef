"""``python -m proof.training``: the speed of training, also where the package is not installed."""

from __future__ import annotations

import typer

from proof.training.command import train

if __name__ == "__main__":
    typer.run(train)
