"""``python -m fake_robot``: the same as ``spot-rl fake-robot``, also where the console script is not installed."""

from spot_model.__main__ import leave_out_current_folder
from spot_model.process.python_path import leave_out_relative_entries


def main() -> None:
    """Run the command with the process's own arguments."""
    leave_out_current_folder()
    leave_out_relative_entries()
    import sys

    import typer

    from fake_robot.start.commands import app
    from spot_model.console.command_line import error_line, exit_code_of
    from spot_model.errors import SpotRlError
    from spot_model.process.inherited import set_right

    set_right()
    try:
        typer.main.get_command(app).main(args=sys.argv[1:], prog_name="python -m fake_robot")
    except (SpotRlError, OSError) as error:
        typer.echo(error_line(error, "fake-robot", is_debug=False), err=True)
        raise SystemExit(exit_code_of(error)) from None


if __name__ == "__main__":
    main()
