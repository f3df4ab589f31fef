"""``python -m trainer``: the trainer's commands where the package is not installed."""

from typing import TYPE_CHECKING

from spot_model.__main__ import leave_out_current_folder

if TYPE_CHECKING:
    import typer


def commands() -> "typer.Typer":
    """The trainer's commands."""
    import typer

    from trainer.evaluate.command import evaluate
    from trainer.evaluate.export_command import export
    from trainer.ppo.train_command import train
    from trainer.refine.command import refine

    app = typer.Typer(no_args_is_help=True, add_completion=False)
    for command in (train, export, evaluate, refine):
        app.command(command.__name__)(command)
    return app


def main() -> None:
    """Run the command that the process's arguments name."""
    leave_out_current_folder()
    from spot_model.errors import SpotRlError
    from spot_model.process.inherited import set_right

    set_right()
    try:
        commands()()
    except SpotRlError as error:
        import typer

        typer.echo(f"error: {error}", err=True)
        raise SystemExit(error.exit_code) from None


if __name__ == "__main__":
    main()
