"""Write the generated pages of the documentation, or check that they are what would be written.

python scripts/write_docs.py            write the pages commands, config, scenario and conformance
python scripts/write_docs.py --check    write nothing; exit 1 and name the pages that differ
"""

from __future__ import annotations

import argparse
import sys
import typing
from collections.abc import Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import click
import typer
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from fake_robot.conformance.table import markdown
from fake_robot.scenario.scenario import Scenario, shipped_names
from spot_model.io.command_line import GROUP_HELP
from spot_model.io.command_registry import COMMAND_GROUP, load_command
from spot_runtime.config import RunConfig

DOCS = Path(__file__).resolve().parent.parent / "docs"
NOTE = "<!-- written by scripts/write_docs.py; change the code, then run 'make docs' -->\n\n"


def commands_page() -> str:
    """Every command with its arguments and options."""
    parts = [
        "# Commands\n",
        f"{NOTE}Exit codes: 0 done, 1 and 2 bad usage or input; those of runs are in [runtime](runtime.md).\n",
    ]
    for entry in sorted(entry_points(group=COMMAND_GROUP), key=lambda e: e.name):
        if entry.value.startswith(("spot_", "fake_robot", "trainer", "diagnosis", "withheld")):
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
    rows = [parameter_row(p) for p in command.params if not getattr(p, "hidden", False) and p.name != "help"]
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
    default = parameter.default
    shown = "" if default in (None, "", (), [], False) or callable(default) else f"`{default}`"
    return f"| {name}{' (required)' if parameter.required else ''} | {shown} | {help_text} |"


def config_page() -> str:
    """Every key of a run's configuration."""
    text = (
        "# Configuration\n\n"
        + NOTE
        + "A YAML file, `--config FILE` of `spot-rl run`, `serve` and `collect`. Every key may be left "
        "out; an unknown one is refused. The whole configuration, with what was left out, is in each log's header.\n\n"
        "```yaml\nschema: spot-rl/run/1\nlog:\n  directory: logs\n```\n"
    )
    for name, field in RunConfig.model_fields.items():
        part = field.annotation
        if isinstance(part, type) and issubclass(part, BaseModel):
            text += (
                f"\n## {name}\n\n{cell(part.__doc__ or '')}\n\n| key | type | default | meaning |\n|---|---|---|---|\n"
            )
            text += "".join(key_row(key, about) for key, about in part.model_fields.items())
    return text


def scenario_page() -> str:
    """Every key of a fake robot's scenario."""
    text = (
        "# The fake robot's scenario\n\n"
        + NOTE
        + "A YAML file, `--scenario FILE` of `spot-rl fake-robot`. Every key may be left out; an unknown one is "
        "refused. `--scenario NAME` takes a shipped one: "
        + ", ".join(f"`{name}`" for name in shipped_names())
        + ".\n\n```yaml\nschema: spot-rl/scenario/1\nterrain: {friction: 0.4}\n```\n"
        "\n| key | type | default | meaning |\n|---|---|---|---|\n"
    )
    parts = {}
    for name, field in Scenario.model_fields.items():
        part = field.annotation
        if isinstance(part, type) and issubclass(part, BaseModel):
            parts[name] = part
        else:
            text += key_row(field.alias or name, field)
    for name, part in parts.items():
        text += f"\n## {name}\n\n{cell(part.__doc__ or '')}\n\n| key | type | default | meaning |\n|---|---|---|---|\n"
        text += "".join(key_row(key, about) for key, about in part.model_fields.items())
    return text


def conformance_page() -> str:
    """What a robot may refuse."""
    return (
        "# What a robot may refuse\n\n"
        + NOTE
        + "Every check that the fake robot makes of a client, and every answer that a client may rely on, with how we "
        "know it. The fake refuses whatever the protos say that a robot may refuse; where nobody outside the vendor "
        "knows, the row is *our guess*, and the last column names the key of the [scenario](scenario.md) that changes "
        "the fake's answer.\n\n"
        "The same table runs against any server that claims to be a Spot:\n\n"
        "<!-- doc-test: run -->\n```sh\nspot-rl fake-robot exec -- spot-rl fake-robot conformance --robot HOST\n```\n\n"
        "It logs in with `BOSDYN_CLIENT_USERNAME` and `BOSDYN_CLIENT_PASSWORD`, moves nothing, and never takes a lease "
        "that somebody holds. `--with-motion` also powers the motors, stands, walks half a metre and sits. A host that "
        "may be a real robot needs `--i-stand-beside-it`: stand beside it with its e-stop in your hand. The exit code "
        "is 1 if a rule that is documented or measured is broken; a guess that the server does not share *differs*.\n\n"
        + markdown()
    )


def key_row(key: str, field: Any) -> str:
    """One key."""
    default = field.default_factory() if field.default is PydanticUndefined and field.default_factory else field.default
    shown = (
        "–" if default in (None, "", (), {}) else f"`{str(default).lower() if isinstance(default, bool) else default}`"
    )
    bounds = [bound for word in field.metadata for bound in bound_words(word)]
    meaning = cell(" ".join([field.description or "", f"({', '.join(bounds)})" if bounds else ""]))
    return f"| `{key}` | {type_words(field.annotation)} | {shown} | {meaning} |\n"


def bound_words(constraint: Any) -> Iterator[str]:
    """A constraint of pydantic's in signs."""
    for name, sign in (("gt", ">"), ("ge", "≥"), ("lt", "<"), ("le", "≤")):
        value = getattr(constraint, name, None)
        if value is not None:
            yield f"{sign} {value:g}"


def type_words(annotation: Any) -> str:
    """A type as a person says it."""
    names = {
        float: "number",
        int: "whole number",
        str: "text",
        bool: "true, false",
        Path: "path",
        type(None): "nothing",
    }
    if annotation in names:
        return names[annotation]
    if typing.get_origin(annotation) is typing.Annotated:
        return type_words(typing.get_args(annotation)[0])
    if typing.get_origin(annotation) is typing.Literal:
        return ", ".join(map(str, typing.get_args(annotation)))
    words = [type_words(arg) for arg in typing.get_args(annotation) if arg is not Ellipsis]
    if typing.get_origin(annotation) in (tuple, list):
        return f"list of {words[0]}s"
    if typing.get_origin(annotation) is dict:
        return "mapping of texts"
    return " or ".join(words)


def cell(text: str) -> str:
    """Text for one cell of a table."""
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    is_check = parser.parse_args().check
    pages = {
        "commands.md": commands_page(),
        "config.md": config_page(),
        "scenario.md": scenario_page(),
        "conformance.md": conformance_page(),
    }
    different = []
    for name, text in pages.items():
        path = DOCS / name
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            different.append(name)
            if not is_check:
                path.write_text(text, encoding="utf-8")
    if is_check and different:
        sys.exit(f"docs/{', docs/'.join(different)} are not what the code says; run 'make docs' and commit")


if __name__ == "__main__":
    main()
