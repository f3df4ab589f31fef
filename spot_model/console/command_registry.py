"""The sub-commands that installed packages offer, found and described without importing them.

A command is an entry point of group ``spot_rl.commands``::

    [project.entry-points."spot_rl.commands"]
    train = "trainer.commands:train [train]"

The value names a function that Typer can turn into a command, or a ``typer.Typer`` app with sub-commands of its own.
The extra in brackets is the one to install when a module that the command needs is missing. A name with a dot, such as
``bench.train``, is a command of a group, ``spot-rl bench train``, so that several packages can fill one group.
Options that commands of several packages share stand here, too.
"""

from __future__ import annotations

import importlib.util
import re
import sys
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Annotated

import typer

from spot_model.errors import SpotRlError
from spot_model.policy.built_in import config_file, policy_file
from spot_model.user_code import OWN_PACKAGES

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
_POLICY_HELP = "ONNX file with its contract, or a built-in policy's name."
PolicyFile = Annotated[Path, typer.Option("--policy", parser=policy_file, metavar="POLICY", help=_POLICY_HELP)]
OptionalPolicyFile = Annotated[
    Path | None, typer.Option("--policy", parser=policy_file, metavar="POLICY", help=_POLICY_HELP)
]
PolicyArgument = Annotated[Path, typer.Argument(parser=policy_file, metavar="POLICY", help=_POLICY_HELP)]
_RAN_HELP = "The policy that ran; default: the built-in one, or the file in ./policies, with the log's digest."
PolicyThatRan = Annotated[Path | None, typer.Option("--policy", parser=policy_file, metavar="POLICY", help=_RAN_HELP)]
_CONFIG_HELP = "YAML file, or the name of a built-in config."
TrainingConfig = Annotated[
    Path | None, typer.Option("--config", parser=config_file, metavar="CONFIG", help=_CONFIG_HELP)
]
Overrides = Annotated[list[str] | None, typer.Option("--set", help="Override: key.path=value; repeatable.")]
TorchDevice = Annotated[str, typer.Option("--device", help="cpu, cuda or cuda:N.")]
ScenarioName = Annotated[str, typer.Option("--scenario", help="Scenario of the fake robot.")]


COMMAND_GROUP = "spot_rl.commands"
EXTRAS_FOR_PYTHON_3_10 = frozenset({"runtime", "gamepad"})
_DOCSTRING = re.compile(r'(?:#.*\n|\s)*[rR]?"""\s*(.*?)\s*(?:"""|$)', re.MULTILINE)
"""A docstring at this place, after comments; its first line is the group."""


class CommandUnavailableError(SpotRlError):
    """A command cannot be loaded; the user can do something about it."""

    exit_code = 2


def find_commands() -> dict[str, EntryPoint]:
    """Return the installed commands by name, in alphabetical order.

    Raises:
        CommandUnavailableError: Two packages offer different commands of one name, or a command and a group share one.
    """
    commands: dict[str, EntryPoint] = {}
    for entry in sorted(entry_points(group=COMMAND_GROUP), key=lambda e: (e.name, e.value)):
        other = commands.setdefault(entry.name, entry)
        if other.value != entry.value:
            raise CommandUnavailableError(
                f"two packages offer the command {entry.name!r}: {other.value} and {entry.value}; uninstall one"
            )
    for name in commands:
        group = name.partition(".")[0]
        if group != name and group in commands:
            raise CommandUnavailableError(
                f"the name {group!r} is both a command ({commands[group].value}) and the group of {name!r}; rename one"
            )
    return commands


def describe_command(entry: EntryPoint) -> str:
    """Return the first docstring line of what ``entry`` names, found in its source, which is not imported.

    A function answers with its own docstring, an app with its module's. Empty where there is no source or docstring.
    To parse the sources of all commands takes longer than all else that prints the help, so they are searched.
    """
    source = source_of(entry.module)
    text = "" if source is None else source.read_text(encoding="utf-8")
    signature = re.search(rf"^def {re.escape(entry.attr)}\((?:.*|(?:\n(?:[ \t].*)?)*\n\).*):\n", text, re.MULTILINE)
    docstring = _DOCSTRING.match(text, signature.end() if signature else 0)
    return docstring[1] if docstring else ""


def load_command(entry: EntryPoint) -> object:
    """Import and return what ``entry`` names.

    Raises:
        CommandUnavailableError: A third-party module that it imports is not installed (the message names the extra), or
            the extra needs a newer Python than this.
        ModuleNotFoundError: One of our own modules is missing, which no extra would mend.
    """
    if sys.version_info < (3, 11) and not EXTRAS_FOR_PYTHON_3_10.issuperset(entry.extras):
        raise CommandUnavailableError(
            f"{_words(entry)} needs Python 3.11 or later, and this is {sys.version.split()[0]}; "
            "on an older one install only the extras runtime and gamepad"
        )
    try:
        return entry.load()
    except ModuleNotFoundError as error:
        raise explain_missing_module(entry, error) from error


def explain_missing_module(entry: EntryPoint, error: ModuleNotFoundError) -> Exception:
    """Turn a missing third-party module into advice; hand the error back when the module is one of ours."""
    missing = (error.name or "").partition(".")[0]
    if not missing or missing in OWN_PACKAGES:
        return error
    extra = entry.extras[0] if entry.extras else "runtime"
    return CommandUnavailableError(
        f"{_words(entry)} needs the module {missing!r}, which is not installed; "
        f"install the extra {extra!r}: pip install 'spot-rl[{extra}]'"
    )


def _words(entry: EntryPoint) -> str:
    return f"'spot-rl {entry.name.replace('.', ' ')}'"


def source_of(module: str) -> Path | None:
    """Return the source file of ``module``, found from its top package so that not even its parents are imported."""
    top, *rest = module.split(".")
    spec = importlib.util.find_spec(top)
    if spec is None or spec.origin is None:
        return None
    path = Path(spec.origin).parent.joinpath(*rest) if rest else Path(spec.origin)
    candidates = (path.with_suffix(".py"), path / "__init__.py")
    return next((candidate for candidate in candidates if candidate.is_file()), None)
