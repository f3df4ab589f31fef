"""The console script ``spot-rl``: finds the commands, loads only the requested one, and prints errors."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable, Sequence
from importlib.metadata import EntryPoint, version
from typing import Annotated, Any, cast

import typer
from typer.core import TyperGroup

from spot_model.console.command_registry import (
    describe_command,
    explain_missing_module,
    find_commands,
    load_command,
    source_of,
)
from spot_model.errors import BadInputError, GpuMemoryError, SpotRlError, system_words
from spot_model.text import plain_lines
from spot_model.user_code import users_error

INTERNAL_ERROR_EXIT_CODE = 70
INTERRUPTED_EXIT_CODE = 130
COMPLETE_VARIABLE = "_SPOT_RL_COMPLETE"
"""Set by the shell while it asks for completions."""
SETTINGS = {"help_option_names": ["-h", "--help"]}
PANELS = {
    "Walk": ("demo", "play", "fake-robot", "run", "serve", "ctl", "doctor", "make-safe"),
    "Logs": ("log", "compare", "prune-logs"),
    "Policies": ("train", "export", "evaluate", "refine", "policy"),
    "From gap to policy": ("collect", "user-sequence", "sysid", "diagnose", "improve"),
}
"""Headings of ``spot-rl --help``, and the commands below each."""
FOR_DEVELOPERS = ("bench", "withheld")
"""Commands that ``spot-rl --help`` leaves out."""
GROUP_HELP = {
    "bench": "Measure one thing on this machine; with --json, print it as one object.",
    "policy": "Show, sign and verify policies, and import those of other frameworks.",
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run ``spot-rl`` with ``arguments`` (the process's own by default) and leave through ``SystemExit``.

    Exit codes: 0 success, 1 an error of ours (or the error's own code), 2 wrong usage or a missing extra, 70 a defect
    of this program, 130 interrupted.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    # Only flags stand before a command's name, so everything up to its first word belongs to the group.
    named = [word for word in _typed(words) if not word.startswith("-")][:2]
    is_debug = "--debug" in (words[: words.index(named[0])] if named and named[0] in words else words)
    chosen: str | None = named[0] if named else None
    entry: EntryPoint | None = None
    try:
        commands = find_commands()
        chosen = next((name for name in (".".join(named), chosen) if name in commands), chosen)
        entry = commands.get(chosen) if chosen else None
        # Where a command comes first, nothing of the others is shown.
        app = build_app({entry.name: entry} if entry and words[:1] == named[:1] else commands, chosen)
        typer.main.get_command(app).main(args=words, prog_name="spot-rl")
    except (KeyboardInterrupt, SystemExit) as end:
        if isinstance(end, SystemExit) and not _was_interrupted(end):
            raise
        typer.echo(f"{_prefix(chosen)}: interrupted", err=True)
        raise SystemExit(INTERRUPTED_EXIT_CODE) from None
    except Exception as error:  # noqa: BLE001 - the last place where an error can become a line for the user
        told = explain_missing_module(entry, error) if entry and isinstance(error, ModuleNotFoundError) else error
        known = _opengl_error(error) or _gpu_memory_error(error)
        told = known or users_error(error, source_of(entry.module) if entry else None) or told
        if is_debug:
            traceback.print_exception(error)
        typer.echo(error_line(told, chosen, is_debug=is_debug), err=True)
        raise SystemExit(exit_code_of(told)) from None


def _opengl_error(error: Exception) -> Exception | None:
    """A drawing library that MUJOCO_GL names and the system lacks: it fails as MuJoCo is imported, in its own words."""
    chosen = os.environ.get("MUJOCO_GL")
    last = traceback.extract_tb(error.__traceback__)[-1:]
    if not chosen or not any("OpenGL" in frame.filename or "gl_context" in frame.filename for frame in last):
        return None
    return BadInputError(
        f"MUJOCO_GL={chosen}: this drawing library cannot be loaded ({error}); install it (Debian: libegl1 for egl, "
        "libosmesa6 for osmesa), or unset MUJOCO_GL"
    )


def _gpu_memory_error(error: Exception) -> Exception | None:
    """An allocation on a GPU that failed, in torch's words or in Warp's; neither library is loaded here."""
    text = str(error)
    if type(error).__name__ != "OutOfMemoryError" and not ("Failed to allocate" in text and "cuda" in text):
        return None
    first = text.splitlines()[0] if text else type(error).__name__
    return GpuMemoryError(
        f"the GPU has too little memory ({first}); simulate fewer robots (train: --set n_envs=N), end other programs "
        "that use it, or work on the cores (--device cpu)"
    )


def _was_interrupted(end: SystemExit) -> bool:
    """Whether typer left for a Ctrl-C that the command itself said nothing of."""
    return end.__context__ is not None and isinstance(end.__context__.__cause__, KeyboardInterrupt)


def _prefix(command: str | None) -> str:
    return f"spot-rl {command.replace('.', ' ') if command else ''}".rstrip()


class _Group(TyperGroup):
    """A group whose help shows the commands under their headings, each with its whole line."""

    def get_params(self, ctx: Any) -> list[Any]:
        """The options. A flag that is left out is false: where it is none, typer loads pydantic to say so."""
        parameters: list[Any] = super().get_params(ctx)
        for parameter in parameters:
            if getattr(parameter, "is_flag", False) and parameter.default is None:
                parameter.default = False
        return parameters

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write them."""
        shown: dict[str, Any] = {name: command for name, command in self.commands.items() if not command.hidden}
        width = max(map(len, shown), default=0)
        panels: dict[str, list[tuple[str, str]]] = {}
        for name, command in shown.items():
            line = name.ljust(width), command.get_short_help_str(limit=sys.maxsize)
            panels.setdefault(command.rich_help_panel or "Commands", []).append(line)
        for panel, lines in panels.items():
            with formatter.section(panel):
                formatter.write_dl(lines)


def build_app(commands: dict[str, EntryPoint], chosen: str | None) -> typer.Typer:
    """Build the group: the chosen command loaded, every other one a stand-in that only carries its help line.

    Help and errors are plain text: to load what draws boxes around them would take longer than all the rest.
    """
    shared: dict[str, Any] = {"cls": _Group, "no_args_is_help": True, "rich_markup_mode": None}
    app = typer.Typer(callback=_group_options, context_settings=SETTINGS, **shared)
    groups = {"": app}
    for name in sorted(commands, key=_rank):
        entry = commands[name]
        group, _, leaf = name.rpartition(".")
        if group not in groups:
            groups[group] = typer.Typer(callback=_stand_in, help=GROUP_HELP.get(group), **shared)
            app.add_typer(groups[group], name=group, rich_help_panel=_panel(group), hidden=group in FOR_DEVELOPERS)
        place: dict[str, Any] = {"rich_help_panel": _panel(name), "hidden": name in FOR_DEVELOPERS}
        if name != chosen:
            groups[group].command(leaf, help=describe_command(entry), **place)(_stand_in)
            continue
        loaded = load_command(entry)
        if isinstance(loaded, typer.Typer):
            groups[group].add_typer(loaded, name=leaf, cls=_Group, **place)
        else:
            groups[group].command(leaf, **place)(cast("Callable[..., Any]", loaded))
    return app


def _typed(words: Sequence[str]) -> list[str]:
    """The words of the command line, or, while a shell completes, those that it has so far."""
    if COMPLETE_VARIABLE not in os.environ:
        return list(words)
    line = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS", "")
    return line.split()[1:]


def _rank(name: str) -> int:
    """Where a command stands in the help: as in :data:`PANELS`, then all others."""
    placed = [n for names in PANELS.values() for n in names]
    return placed.index(name) if name in placed else len(placed)


def _panel(name: str) -> str | None:
    return next((panel for panel, names in PANELS.items() if name in names), None)


def error_line(error: Exception, command: str | None, *, is_debug: bool) -> str:
    """Word an error as one line: ours by its message, the system's by its text, any other as a defect of ours."""
    prefix = _prefix(command)
    if isinstance(error, SpotRlError):
        return plain_lines(f"{prefix}: error: {error}")
    if isinstance(error, OSError):
        return plain_lines(f"{prefix}: error: {system_words(error)}")
    hint = "" if is_debug else f"; '{prefix.replace('spot-rl', 'spot-rl --debug', 1)}' shows where"
    return plain_lines(f"{prefix}: internal error: {type(error).__name__}: {error}{hint}")


def exit_code_of(error: Exception) -> int:
    """Return the process's exit code for an error that ended a command."""
    if isinstance(error, SpotRlError):
        return error.exit_code
    return 1 if isinstance(error, OSError) else INTERNAL_ERROR_EXIT_CODE


def _print_version(is_asked: bool) -> None:
    if is_asked:
        typer.echo(f"spot-rl {version('spot-rl')}")
        raise typer.Exit


def _group_options(
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and leave.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Train, run, log and explain reinforcement-learning policies for Boston Dynamics Spot.

    'spot-rl --install-completion' sets up completion in your shell. The distribution spot-rl-lab, which
    comes with a clone, adds 'spot-rl bench' (measurements) and 'spot-rl withheld' (tests of the diagnosis).
    """


def _stand_in() -> None:
    """Stand for a command that was not asked for."""
