"""``python -m trainer``: the trainer's commands where the package is not installed."""

from __future__ import annotations

import sys

import typer

from spot_model.errors import SpotRlError
from trainer.evaluate.command import evaluate
from trainer.export.export_command import export
from trainer.ppo.train_command import train
from trainer.refine.command import refine

app = typer.Typer(no_args_is_help=True, add_completion=False)
app.command("train")(train)
app.command("export")(export)
app.command("evaluate")(evaluate)
app.command("refine")(refine)

if __name__ == "__main__":
    try:
        app()
    except SpotRlError as error:
        typer.echo(f"error: {error}", err=True)
        sys.exit(error.exit_code)
