"""Write the generated pages of the documentation: docs/reference/, which is not committed, and the bounds of safety.

python scripts/write_docs.py            write them: docs/reference/, and the bounds in docs/method/safety-checks.md
python scripts/write_docs.py --check    write docs/reference/; exit 1 if the bounds are not what the code says
"""

from __future__ import annotations

import argparse
import sys
import typing
from collections.abc import Iterator
from enum import Enum
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import click
import typer
from pydantic import BaseModel
from reference.conformance import conformance_page
from reference.effects import effects_page
from reference.files import files_page
from reference.log_schema import log_page
from reference.mapping import mapping_page
from reference.python_api import python_page
from reference.safety import safety_page
from reference.scenario import scenario_page
from reference.stops import stops_page
from reference.training import training_page
from reference.verdict import verdict_page
from reference.words import NOTE, cell, keys_table

from spot_model.console.command_line import GROUP_HELP
from spot_model.console.command_registry import COMMAND_GROUP, load_command
from spot_runtime.config import RunConfig

DOCS = Path(__file__).resolve().parent.parent / "docs"
EVERYWHERE = ("help", "install_completion", "show_completion")
"""Options that say nothing about a command."""


def commands_page() -> str:
    """Every command with its arguments and options."""
    parts = ["# Commands\n", f"{NOTE}[Exit codes](stops.md) are the same for all commands.\n"]
    for entry in sorted(entry_points(group=COMMAND_GROUP), key=lambda e: e.name):
        if entry.value.startswith(("spot_", "fake_robot", "trainer", "diagnosis", "compare", "proof", "withheld")):
            for words, command in walk(f"spot-rl {entry.name.replace('.', ' ')}", click_command(load_command(entry))):
                parts.append(command_section(words, command))
    return "\n".join(parts)


def click_command(loaded: Any) -> click.Command:
    """A Typer app or a function as a click command."""
    if isinstance(loaded, typer.Typer):
        return typing.cast("click.Command", typer.main.get_command(loaded))
    app = typer.Typer(add_completion=False)
    app.command()(loaded)
    return typing.cast("click.Command", typer.main.get_command(app))


def walk(words: str, command: click.Command) -> Iterator[tuple[str, click.Command]]:
    """The command and its sub-commands."""
    yield words, command
    for name, child in sorted(getattr(command, "commands", {}).items()):
        yield from walk(f"{words} {name}", child)


def command_section(words: str, command: click.Command) -> str:
    """One command."""
    group = GROUP_HELP.get(words.partition(" ")[2], "")
    lines = [f"## {words}\n", " ".join((command.help or group).split()) + "\n"]
    rows = [parameter_row(p) for p in command.params if not getattr(p, "hidden", False) and p.name not in EVERYWHERE]
    if rows:
        lines += ["| | default | meaning |", "|---|---|---|", *rows, ""]
    return "\n".join(lines)


def parameter_row(parameter: click.Parameter) -> str:
    """One argument or option."""
    help_text = cell(getattr(parameter, "help", None) or "")
    if isinstance(parameter, click.Option) or getattr(parameter, "param_type_name", "") == "option":
        name = "`" + ", ".join(parameter.opts + parameter.secondary_opts) + "`"
    else:
        name = f"`{(parameter.name or '').upper()}`"
    default = parameter.default if getattr(parameter, "show_default", True) else None
    value = default.value if isinstance(default, Enum) else default
    shown = "" if value in (None, "", (), [], False) or callable(value) else f"`{value}`"
    return f"| {name}{' (required)' if parameter.required else ''} | {shown} | {help_text} |"


def config_page() -> str:
    """Every key of a run's configuration."""
    text = (
        "# Configuration\n\n"
        + NOTE
        + "A YAML file, `--config FILE` of `spot-rl run`, `serve` and `collect`. All keys are "
        "optional; unknown keys are refused. Each log's header holds the whole configuration, defaults included.\n\n"
        "```yaml\nschema: spot-rl/run/1\nlog:\n  directory: logs\n```\n"
    )
    for name, field in RunConfig.model_fields.items():
        part = field.annotation
        if isinstance(part, type) and issubclass(part, BaseModel):
            text += f"\n## {name}\n\n{cell(part.__doc__ or '')}\n\n{keys_table(part)}"
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="compare what is committed, instead of writing it")
    is_check = parser.parse_args().check
    pages = {
        "reference/commands.md": commands_page(),
        "reference/config.md": config_page(),
        "method/safety-checks.md": safety_page((DOCS / "method/safety-checks.md").read_text(encoding="utf-8")),
        "reference/scenario.md": scenario_page(),
        "reference/conformance.md": conformance_page(),
        "reference/stops.md": stops_page(),
        "reference/effects.md": effects_page(),
        "reference/files.md": files_page(),
        "reference/training-config.md": training_page(),
        "reference/log-schema.md": log_page(),
        "reference/mapping.md": mapping_page(),
        "reference/verdict.md": verdict_page(),
        "reference/python.md": python_page(),
    }
    different = []
    for name, text in pages.items():
        path, is_committed = DOCS / name, not name.startswith("reference/")
        if is_check and is_committed and path.read_text(encoding="utf-8") != text:
            different.append(name)
        else:
            path.write_text(text, encoding="utf-8")
    if different:
        sys.exit(f"docs/{', docs/'.join(different)} are not what the code says; run 'make docs' and commit")


if __name__ == "__main__":
    main()
