from __future__ import annotations

import errno
import inspect
import os
import subprocess
import sys
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType

import pytest
import typer

from spot_model.console import command_line, command_registry
from spot_model.console.command_registry import COMMAND_GROUP, CommandUnavailableError, describe_command, find_commands
from spot_model.errors import BadInputError

MODULE = '''"""Help of the module."""

import typer

from spot_model.errors import SpotRlError

app = typer.Typer()


def walk(distance_m: float = 1.0) -> None:
    """Walk some way.

    More about it.
    """
    print(f"walked {distance_m} m")


def fail() -> None:
    """Fail with an error of ours."""
    raise SpotRlError("leg 'xx' is unknown; use one of fl, fr, hl, hr")


def break_down() -> None:
    """Fail with a defect."""
    raise KeyError("knee")


@app.command()
def one() -> None:
    """Do one thing."""
    print("one")


@app.command()
def two() -> None:
    """Do another thing."""
'''


@pytest.fixture
def commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, EntryPoint]:
    (tmp_path / "some_commands.py").write_text(MODULE)
    (tmp_path / "heavy_commands.py").write_text('"""Needs much."""\nimport no_such_library.part\n')
    (tmp_path / "broken_commands.py").write_text("import trainer.no_such_module\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    values = {
        "walk": "some_commands:walk",
        "fail": "some_commands:fail",
        "break": "some_commands:break_down",
        "group": "some_commands:app",
        "heavy": "heavy_commands:app [train]",
        "broken": "broken_commands:app",
        "bench.walk": "some_commands:walk",
        "bench.heavy": "heavy_commands:app [train]",
    }
    found = {name: EntryPoint(name, value, COMMAND_GROUP) for name, value in values.items()}
    monkeypatch.setattr(command_line, "find_commands", lambda: found)
    return found


def run(*words: str) -> int:
    with pytest.raises(SystemExit) as left:
        command_line.main(words)
    return int(left.value.code or 0)


@pytest.mark.usefixtures("commands")
class TestMain:
    def test_runs_a_function_with_its_options(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert run("walk", "--distance-m", "2.5") == 0
        assert capsys.readouterr().out == "walked 2.5 m\n"

    def test_runs_a_command_of_an_app(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert run("group", "one") == 0
        assert capsys.readouterr().out == "one\n"

    def test_a_dotted_name_is_a_command_of_a_group(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert run("bench", "walk", "--distance-m", "3.5") == 0
        assert capsys.readouterr().out == "walked 3.5 m\n"
        assert run("bench", "--help") == 0
        out = capsys.readouterr().out
        assert "Walk some way." in out
        assert "Needs much." in out
        assert run("bench", "heavy") == 2
        assert capsys.readouterr().err.startswith("spot-rl bench heavy: error: 'spot-rl bench heavy' needs the module")

    def test_help_lists_every_command_and_imports_none(self, capsys: pytest.CaptureFixture[str]) -> None:
        sys.modules.pop("some_commands", None)
        assert run("--help") == 0
        out = capsys.readouterr().out
        for line in ("Walk some way.", "Fail with a defect.", "Help of the module.", "Needs much."):
            assert line in out
        assert "some_commands" not in sys.modules

    def test_help_of_a_command_is_its_own_and_no_other_is_described(
        self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(command_line, "describe_command", None)
        assert run("walk", "--help") == 0
        assert "--distance-m" in capsys.readouterr().out

    def test_an_error_of_ours_is_one_line(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert run("fail") == 1
        assert capsys.readouterr().err == "spot-rl fail: error: leg 'xx' is unknown; use one of fl, fr, hl, hr\n"

    def test_a_defect_is_one_line_that_says_how_to_see_more(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert run("break") == 70
        err = capsys.readouterr().err
        assert err == "spot-rl break: internal error: KeyError: 'knee'; 'spot-rl --debug break' shows where\n"

    def test_debug_shows_the_traceback(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert run("--debug", "break") == 70
        err = capsys.readouterr().err
        assert "Traceback (most recent call last)" in err
        assert "in break_down" in err

    def test_a_missing_library_names_the_extra(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert run("heavy") == 2
        assert capsys.readouterr().err == (
            "spot-rl heavy: error: 'spot-rl heavy' needs the module 'no_such_library', which is not installed; "
            "install the extra 'train': pip install 'spot-rl[train]'\n"
        )

    def test_an_old_python_is_told_so(
        self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(sys, "version_info", (3, 10, 13))
        assert run("heavy") == 2
        assert "'spot-rl heavy' needs Python 3.11 or later, and this is" in capsys.readouterr().err
        assert run("walk", "--distance-m", "1") == 0

    def test_a_missing_module_of_ours_is_a_defect(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert run("broken") == 70
        assert "trainer.no_such_module" in capsys.readouterr().err

    def test_an_unknown_command_is_wrong_usage(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert run("wlak") == 2
        assert "wlak" in capsys.readouterr().err

    def test_version(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert run("--version") == 0
        assert capsys.readouterr().out.startswith("spot-rl 0.")


def test_exit_codes_follow_the_error() -> None:
    assert command_line.exit_code_of(BadInputError("x")) == 2
    assert command_line.exit_code_of(FileNotFoundError("x")) == 1
    assert command_line.exit_code_of(ZeroDivisionError()) == 70


def test_two_packages_with_one_command_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    rivals = [EntryPoint("walk", "ours:walk", COMMAND_GROUP), EntryPoint("walk", "theirs:walk", COMMAND_GROUP)]
    monkeypatch.setattr(command_registry, "entry_points", lambda **_group: rivals)
    with pytest.raises(CommandUnavailableError, match="'walk': ours:walk and theirs:walk; uninstall one"):
        find_commands()


def test_a_command_and_a_group_of_one_name_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    rivals = [EntryPoint("bench", "ours:app", COMMAND_GROUP), EntryPoint("bench.train", "ours:train", COMMAND_GROUP)]
    monkeypatch.setattr(command_registry, "entry_points", lambda **_group: rivals)
    with pytest.raises(CommandUnavailableError, match=r"'bench' is both a command .ours:app. and the group"):
        find_commands()


@pytest.mark.parametrize("entry", entry_points(group=COMMAND_GROUP), ids=lambda entry: entry.name)
def test_every_installed_command_loads_and_describes_itself(entry: EntryPoint) -> None:
    loaded = entry.load()
    assert callable(loaded) or isinstance(loaded, typer.Typer)
    documented = sys.modules[entry.module] if isinstance(loaded, typer.Typer) else loaded
    assert describe_command(entry) == str(inspect.getdoc(documented)).partition("\n")[0]
    assert describe_command(entry).endswith(".")
    assert entry.extras


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ('# A licence.\n\n"""Of the module.\n\nMore."""\ndef other() -> None:\n    """Other."""\n', "Of the module."),
        ('"""M."""\n@decorated()\ndef walk(a: int = (1)) -> None:\n    r"""Walk. """\n', "Walk."),
        (
            '"""M."""\ndef walk(\n    a: int,\n\n    b: str = ")",\n) -> None:\n    """Walk.\n\n    Far.\n    """\n',
            "Walk.",
        ),
        ('"""M."""\ndef walk() -> None:\n    run()\n\ndef other() -> None:\n    """Other."""\n', ""),
        ("import os\n", ""),
    ],
)
def test_a_commands_line_is_found_in_its_source(
    text: str, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "described.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert describe_command(EntryPoint("walk", "described:walk", COMMAND_GROUP)) == line


STARTS_LATE = ("bench.", "ctl", "fake-robot", "user-sequence")
"""Commands whose help loads more than it needs; this list may only shrink."""


def test_no_help_imports_anything_heavy() -> None:
    script = (
        "import sys\n"
        "from spot_model.console.command_line import find_commands, main\n"
        "heavy = {'torch', 'mujoco', 'numpy', 'onnxruntime', 'grpc', 'google', 'scipy', 'pydantic', 'yaml'}\n"
        "heavy |= {'rich', 'ssl'}\n"
        f"names = [name.split('.') for name in find_commands() if not name.startswith({STARTS_LATE})]\n"
        "for words in [[], *names]:\n"
        "    try:\n        main([*words, '--help'])\n"
        "    except SystemExit:\n        pass\n"
        "    print(*words, 'loads', heavy & sys.modules.keys())\n"
    )
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    told = [line for line in result.stdout.splitlines() if " loads " in line]
    assert len(told) > 20
    assert [line for line in told if not line.endswith(" loads set()")] == []


def test_the_help_has_headings_and_whole_lines(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--help") == 0
    told = " ".join(capsys.readouterr().out.split())
    for panel, names in command_line.PANELS.items():
        assert f" {panel}: {names[0]} " in told
    assert "hand over, follow velocity commands, hand back, sit, power off." in told
    assert not any(f" {name} " in told.partition("Walk:")[2] for name in command_line.FOR_DEVELOPERS)


class TestCompletion:
    """What a shell is told while somebody types; it asks by variables of the environment."""

    @staticmethod
    def complete(words: str) -> list[str]:
        told = subprocess.run(
            [sys.executable, "-c", "from spot_model.console.command_line import main; main([])"],
            env={
                **os.environ,
                "_SPOT_RL_COMPLETE": "complete_bash",
                "COMP_WORDS": words,
                "COMP_CWORD": str(len(words.split(" ")) - 1),
            },
            capture_output=True,
            text=True,
        )
        assert told.stderr == ""
        return told.stdout.split()

    def test_commands_sub_commands_and_options_are_offered(self) -> None:
        commands = self.complete("spot-rl ")
        assert {"run", "ctl", "diagnose"} <= set(commands)
        assert not {"bench", "withheld"} & set(commands)
        assert self.complete("spot-rl ctl st") == ["status", "start", "stop", "start-log"]
        assert "--lock-step" in self.complete("spot-rl run --lo")
        assert self.complete("spot-rl log inf") == ["info"]


def test_the_short_help_is_the_long_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("policy", "-h") == 0
    short = capsys.readouterr().out
    assert run("policy", "--help") == 0
    assert short == capsys.readouterr().out


def test_every_command_has_a_place_in_the_help() -> None:
    placed = {name for names in command_line.PANELS.values() for name in names} - {"play"}
    assert placed <= {word for name in find_commands() for word in (name, name.partition(".")[0])}


@pytest.mark.parametrize(
    ("number", "next_step"),
    [
        (errno.ENOSPC, "make room, or write elsewhere"),
        (errno.EROFS, "check its permissions, or name another path"),
        (errno.EACCES, "check its permissions, or name another path"),
        (errno.EEXIST, "nothing is overwritten: choose another name"),
        (errno.ENOENT, "check the path, or make its folder first"),
    ],
)
def test_an_error_of_the_system_names_the_file_and_the_next_step(number: int, next_step: str) -> None:
    line = command_line.error_line(OSError(number, os.strerror(number), "out/page.html"), "compare", is_debug=False)
    assert line.startswith(f"spot-rl compare: error: out/page.html: {os.strerror(number)}; ")
    assert next_step in line
    assert "\n" not in line


class _Interrupted(ModuleType):
    """A module while whose import somebody presses Ctrl-C."""

    def __getattr__(self, name: str) -> object:
        raise KeyboardInterrupt


def test_ctrl_c_during_the_first_imports_is_one_line(monkeypatch, capsys) -> None:
    name = "spot_model.console.command_line"
    monkeypatch.setitem(sys.modules, name, _Interrupted(name))
    with pytest.raises(SystemExit) as end:
        entry_points(group="console_scripts", name="spot-rl")["spot-rl"].load()()
    assert end.value.code == 130
    assert capsys.readouterr().err == "spot-rl: interrupted\n"


def test_a_negative_velocity_is_no_option(tmp_path: Path, capsys) -> None:
    with pytest.raises(SystemExit):
        command_line.main(
            ["ctl", "--address", f"unix:{tmp_path}/none.sock", "velocity", "-0.2", "-.1", "-1", "--for", "1"]
        )
    assert "no service answers" in capsys.readouterr().err


def test_logs_without_a_command_are_diagnosed(tmp_path: Path, capsys) -> None:
    with pytest.raises(SystemExit):
        command_line.main(["diagnose", str(tmp_path / "a.mcap"), "--nominal", "ideal", "--out", str(tmp_path / "out")])
    assert "there is no log" in capsys.readouterr().err


def test_a_drawing_library_that_cannot_be_loaded_is_named() -> None:
    told = subprocess.run(
        [sys.executable, "-m", "spot_model", "compare", "a", "b", "--out", "c"],
        env={**os.environ, "MUJOCO_GL": "nonsense"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert told.returncode == 2
    assert "spot-rl compare: error: MUJOCO_GL=nonsense: this drawing library cannot be loaded (" in told.stderr
