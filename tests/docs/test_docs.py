"""The documentation: every command is known, some are run, the site builds. `make check` compares generated pages."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import pytest
import torch
import typer
import yaml

from spot_model.console.command_line import main
from spot_model.console.command_registry import COMMAND_GROUP, load_command
from spot_runtime.config import RunConfig

from .blocks import PAGES, REPOSITORY, all_blocks, blocks_of, spans_of
from .session import Session
from .shorter import SHORTER, shortened

NOT_RUN_HERE = {
    "sudo",
    "systemctl",
    "tensorboard",
    "journalctl",
    "ssh",
    "openssl",
    "cd",
    "export",
    ".",
    "chmod",
    "pip",
    "bash",
    "podman",
}
"""Words of the system: that the commands behind them do what a page says is not tested, but for blocks that are run."""


@cache
def commands() -> dict[str, Any]:
    def as_click(loaded: Any) -> Any:
        if isinstance(loaded, typer.Typer):
            return typer.main.get_command(loaded)
        app = typer.Typer(add_completion=False)
        app.command()(loaded)
        return typer.main.get_command(app)

    return {e.name: as_click(load_command(e)) for e in entry_points(group=COMMAND_GROUP)}


def check_command(words: list[str], *, is_whole: bool = True) -> None:
    """Read the words of a ``spot-rl`` command as the command line would, or only its options; raises what it would."""
    if words[0].startswith("--") or words[0] == "COMMAND":
        return
    name = next((n for n in (".".join(words[:2]), words[0]) if n in commands()), None)
    assert name is not None, f"there is no command {words[0]!r}"
    check_words(commands()[name], words[name.count(".") + 1 :], is_whole=is_whole)


def check_words(command: Any, words: list[str], *, is_whole: bool) -> None:
    inner: list[str] = []
    if "--" in words:
        words, inner = words[: words.index("--")], words[words.index("--") + 1 :]
    words = getattr(command, "named", list)(words)
    children = getattr(command, "commands", {})
    if children:
        rest = words_left(command, words)
        if rest and rest[0] in children:
            check_words(children[rest[0]], rest[1:], is_whole=is_whole)
        else:
            assert not rest, f"there is no sub-command {rest[0]!r}; there are {sorted(children)}"
    elif is_whole and "--help" not in words:
        command.make_context(command.name, list(words))
    elif not is_whole:
        words_left(command, [*words, "…"])  # a sentence may name an option without its argument
    if inner and inner[0] == "spot-rl":
        check_command(inner[1:])


def words_left(command: Any, words: list[str]) -> list[str]:
    """What a command's own options leave."""
    context = command.context_class(command, info_name=command.name)
    return list(command.make_parser(context).parse_args(args=list(words))[1])


def with_siblings(script: Path) -> str:
    """Text of a script, and of the benchmarks that it imports by name alone."""
    text = script.read_text(encoding="utf-8")
    siblings = [
        REPOSITORY / "lab" / "benchmarks" / f"{name}.py"
        for name in re.findall(r"^from (\w+) import", text, re.MULTILINE)
    ]
    return "\n".join([text, *(file.read_text(encoding="utf-8") for file in siblings if file.is_file())])


def check_line(words: list[str], *, is_whole: bool = True) -> None:
    """Read one line of a page; in a sentence, what it needs need not be whole."""
    program = words[0].rpartition("/")[2]
    if program == "spot-rl":
        check_command(words[1:], is_whole=is_whole)
    elif program == "torchrun":
        assert (REPOSITORY / "spot_model" / "__main__.py").is_file()
        check_command(words[words.index("spot_model") + 1 :])
    elif program == "make":
        makefile = (REPOSITORY / "Makefile").read_text(encoding="utf-8")
        for target in (w for w in words[1:] if "=" not in w):
            assert re.search(rf"^{target}:", makefile, re.MULTILINE), f"there is no target {target}"
    elif words[:3] == ["python3", "-m", "venv"]:
        assert len(words) == 4
    elif program in ("python", "python3"):
        script = REPOSITORY / words[1]
        assert script.is_file(), f"there is no script {words[1]}"
        options = [word for word in words if word.startswith("--")]
        assert all(f'"{option}"' in with_siblings(script) for option in options), options
    elif program == "sudo" and words[1] == "python3":
        assert (REPOSITORY / "deploy" / words[2]).is_file()
    else:
        assert program in NOT_RUN_HERE or "=" in program, f"{program!r} is no command that this test knows"


@pytest.fixture
def any_policy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Policies and runs that a page names need not be here."""
    monkeypatch.setattr("spot_model.policy.built_in._find", lambda text, *_: Path(text))


@pytest.mark.usefixtures("any_policy")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_are_read_by_their_own_parsers(page: Path) -> None:
    for block in blocks_of(page):
        for words in block.commands if block.language in ("sh", "") else ():
            check_line(words)
    for words in spans_of(page):
        if words[0] not in ("pip", "torchrun"):
            check_line(words, is_whole=False)


BAD = ("spot-rl nothing", "spot-rl ctl stop --now", "spot-rl ctl jump", "spot-rl run --no-such 1", "make nothing")


@pytest.mark.parametrize(
    ("line", "is_whole"),
    [("spot-rl sysid logs --policy walk.onnx", True), *((line, way) for line in BAD for way in (True, False))],
)
def test_the_reading_can_fail(line: str, is_whole: bool) -> None:
    with pytest.raises(Exception, match=r".+"):
        check_line(line.split(), is_whole=is_whole)


RUN_PAGES = [page for page in PAGES if any(block.order in ("run", "play", "python") for block in blocks_of(page))]


@pytest.fixture(scope="module")
def folder_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Plays a page once and gives the folder in which it was played; two pages begin with another's logs."""

    @cache
    def played(name: str) -> Path:
        folder = tmp_path_factory.mktemp(name) / "a folder"
        if name in ("log", "compare", "play", "other-tools"):
            (folder / "logs").mkdir(parents=True)
            log = next((played("sysid") / "fake-walks").glob("*.mcap")).read_bytes()
            for copy in ("LOG", "OTHER"):
                (folder / "logs" / f"{copy}.mcap").write_bytes(log)
            (folder / "logs" / "LOG.mcap.active").write_bytes(log[: len(log) * 2 // 3])
            if name in ("compare", "play"):
                shutil.copytree(played("diagnosis") / "gap", folder / "gap")
        elif name == "diagnosis":
            shutil.copytree(played("sysid"), folder, symlinks=True)
        else:
            folder.mkdir()
        waiting: list[list[str]] = []
        for block in blocks_of(next(page for page in RUN_PAGES if page.stem == name)):
            kind, _, file = block.order.partition(" ")
            if kind == "play":
                waiting += map(shortened, block.commands)
            elif kind == "file":
                (folder / file).write_text(block.text, encoding="utf-8")
            elif kind == "run":
                play(waiting, folder)
                waiting = []
                bash(block.text, folder)
            elif kind == "python":
                run([sys.executable, "-c", block.text], folder)
        play(waiting, folder)
        return folder

    return played


def play(lines: list[list[str]], folder: Path) -> None:
    """Run commands in turn, in one process with the libraries that they share."""
    if lines:
        run([sys.executable, str(Path(__file__).with_name("one_by_one.py"))], folder, json.dumps(lines))


def bash(text: str, folder: Path) -> None:
    run(["bash", "-euo", "pipefail", "-c", text], folder)


def run(words: list[str], folder: Path, given: str = "") -> None:
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "XDG_STATE_HOME": str(folder / "state")}
    told = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, input=given)
    assert told.returncode == 0, f"{words}\n{told.stdout}\n{told.stderr}"


@pytest.mark.parametrize("page", RUN_PAGES, ids=lambda page: page.stem)
@pytest.mark.slow
def test_marked_blocks_run_as_they_stand(page: Path, folder_of: Callable[[str], Path]) -> None:
    folder_of(page.stem)


def test_what_is_added_belongs_to_a_line_of_a_page() -> None:
    lines = {" ".join(words) for block in all_blocks() if block.order == "play" for words in block.commands}
    assert not SHORTER.keys() - lines


GPU_LINES = [words for block in all_blocks() if block.order == "gpu" for words in block.commands]


@pytest.mark.parametrize("words", GPU_LINES, ids=" ".join)
def test_commands_for_a_gpu_say_so_where_there_is_none(
    words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if torch.cuda.is_available():
        pytest.skip("there is a GPU here; this asks what is said where there is none")
    monkeypatch.chdir(REPOSITORY)
    after = words[words.index("spot_model") + 1 :] if words[0] == "torchrun" else words[1:]
    with pytest.raises(SystemExit):
        main(after)
    assert "there is no usable NVIDIA GPU here" in capsys.readouterr().err


SESSION_PAGES = [page for page in PAGES if any(block.order == "session" for block in blocks_of(page))]


@pytest.mark.parametrize("page", SESSION_PAGES, ids=lambda page: page.stem)
@pytest.mark.slow
def test_sessions_go_as_the_page_says(page: Path, tmp_path: Path) -> None:
    with Session(tmp_path / "a folder") as session:
        for block in blocks_of(page):
            if block.order == "session":
                for line in block.lines:
                    session.play(line)
        assert session.is_at_rest()


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
