"""The documentation: every command in it is known, some are run, generated pages are up to date, the site builds."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml

from spot_model.command_registry import COMMAND_GROUP, load_command
from spot_runtime.config import RunConfig

from .blocks import PAGES, REPOSITORY, Block, all_blocks, blocks_of
from .session import Session

NOT_RUN_HERE = {"sudo", "systemctl", "journalctl", "ssh", "openssl", "cd", "export", ".", "chmod", "pip", "bash"}
"""Words of the system: that the commands behind them do what a page says is not tested, but for blocks that are run."""

READ = [
    pytest.param(block, words, id=f"{block.page.stem}-{' '.join(words)[:70]}")
    for block in all_blocks()
    if block.language in ("sh", "")
    for words in block.commands
]


@cache
def commands() -> dict[str, Any]:
    def as_click(loaded: Any) -> Any:
        if isinstance(loaded, typer.Typer):
            return typer.main.get_command(loaded)
        app = typer.Typer(add_completion=False)
        app.command()(loaded)
        return typer.main.get_command(app)

    return {e.name: as_click(load_command(e)) for e in entry_points(group=COMMAND_GROUP)}


def check_command(words: list[str]) -> None:
    """Read the words of a ``spot-rl`` command as the command line would; raises what it would."""
    if words[:1] in (["--help"], ["--version"], ["COMMAND"]):
        return
    name = next((n for n in (".".join(words[:2]), words[0]) if n in commands()), None)
    assert name is not None, f"there is no command {words[0]!r}"
    check_words(commands()[name], words[name.count(".") + 1 :])


def check_words(command: Any, words: list[str]) -> None:
    inner: list[str] = []
    if "--" in words:
        words, inner = words[: words.index("--")], words[words.index("--") + 1 :]
    children = getattr(command, "commands", {})
    if children:
        context = command.context_class(command, info_name=command.name, resilient_parsing=True)
        _, rest, _ = command.make_parser(context).parse_args(args=list(words))
        if rest:
            assert rest[0] in children, f"there is no sub-command {rest[0]!r}; there are {sorted(children)}"
            check_words(children[rest[0]], rest[1:])
    elif "--help" not in words:
        command.make_context(command.name, list(words))
    if inner and inner[0] == "spot-rl":
        check_command(inner[1:])


def check_line(words: list[str]) -> None:
    """Read one line of a page."""
    program = words[0].rpartition("/")[2]
    if program == "spot-rl":
        check_command(words[1:])
    elif program == "torchrun":
        assert (REPOSITORY / "trainer" / "__main__.py").is_file()
        check_command(words[words.index("trainer") + 1 :])
    elif program == "make":
        makefile = (REPOSITORY / "Makefile").read_text(encoding="utf-8")
        for target in (w for w in words[1:] if "=" not in w):
            assert re.search(rf"^{target}:", makefile, re.MULTILINE), f"there is no target {target}"
    elif program in ("python", "python3"):
        assert (REPOSITORY / words[1]).is_file(), f"there is no script {words[1]}"
    elif program == "sudo" and words[1] == "python3":
        assert (REPOSITORY / "deploy" / words[2]).is_file()
    else:
        assert program in NOT_RUN_HERE or "=" in program, f"{program!r} is no command that this test knows"


@pytest.mark.parametrize(("block", "words"), READ)
def test_commands_are_read_by_their_own_parsers(block: Block, words: list[str]) -> None:
    check_line(words)


@pytest.mark.parametrize(
    "line", ["spot-rl nothing", "spot-rl run --robot x", "spot-rl ctl stop --now", "spot-rl ctl jump", "make nothing"]
)
def test_the_reading_can_fail(line: str) -> None:
    with pytest.raises(Exception, match=r".+"):
        check_line(line.split())


RUN_PAGES = [page for page in PAGES if any(block.order == "run" for block in blocks_of(page))]


@pytest.mark.parametrize("page", RUN_PAGES, ids=lambda page: page.stem)
def test_marked_blocks_run_as_they_stand(page: Path, tmp_path: Path) -> None:
    tmp_path = tmp_path / "a folder"
    tmp_path.mkdir()
    (tmp_path / "policies").symlink_to(REPOSITORY / "policies")
    for block in blocks_of(page):
        kind, _, name = block.order.partition(" ")
        if kind == "file":
            (tmp_path / name).write_text(block.text, encoding="utf-8")
        elif kind == "run":
            path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
            told = subprocess.run(
                ["bash", "-euo", "pipefail", "-c", block.text],
                cwd=tmp_path,
                env={**os.environ, "PATH": path, "XDG_STATE_HOME": str(tmp_path / "state")},
                capture_output=True,
                text=True,
            )
            assert told.returncode == 0, f"{block.text}\n{told.stdout}\n{told.stderr}"


SESSION_PAGES = [page for page in PAGES if any(block.order == "session" for block in blocks_of(page))]


@pytest.mark.parametrize("page", SESSION_PAGES, ids=lambda page: page.stem)
def test_sessions_go_as_the_page_says(page: Path, tmp_path: Path) -> None:
    with Session(tmp_path / "a folder") as session:
        for block in blocks_of(page):
            if block.order == "session":
                for line in block.lines:
                    session.play(line)
        assert session.is_at_rest()


def test_pages_that_are_to_be_run_are_there() -> None:
    assert {page.stem for page in SESSION_PAGES} >= {"first-run-fake", "first-run-spot", "operate"}
    assert {page.stem for page in RUN_PAGES} >= {"first-run-fake", "add-an-effect", "operate"}


def test_yaml_and_python_blocks_are_valid() -> None:
    for block in all_blocks():
        if block.language == "yaml":
            content = yaml.safe_load(block.text)
            if (
                isinstance(content, dict)
                and set(content) <= {"schema", *RunConfig.model_fields}
                and "model" not in content
            ):
                RunConfig.model_validate(content)
        elif block.language == "python":
            compile(block.text, f"{block.page.name}", "exec")


def test_generated_pages_say_what_the_code_says() -> None:
    told = subprocess.run(
        [sys.executable, "scripts/write_docs.py", "--check"], cwd=REPOSITORY, capture_output=True, text=True
    )
    assert told.returncode == 0, told.stderr


def test_the_site_builds_and_asks_nobody_else(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", str(tmp_path / "site")]
    told = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    for page in (tmp_path / "site").rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.findall(r"<(?:script|link|img)[^>]+(?:src|href)=\"https?:", text), page.name
