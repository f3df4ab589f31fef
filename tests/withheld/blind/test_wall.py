"""A diagnosis that tries to cheat is caught: each way, at each level that this machine allows."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from withheld.blind.jail import LEVELS, Ended, JailError, Level, run_locked_in, strongest_level

REFUSED = "withheld check: refused"
Run = Callable[[str], Ended]


@pytest.fixture(params=["namespaces", "audit hook"])
def level(request: pytest.FixtureRequest) -> Level:
    return request.param


@pytest.fixture
def inside(level: Level, tmp_path: Path) -> Run:
    case, out = tmp_path / "case", tmp_path / "out"
    case.mkdir()
    out.mkdir()
    (case / "log.mcap").write_text("signals")

    def run(program: str) -> Ended:
        try:
            return run_locked_in(case, out, (), level, 60.0, program)
        except JailError:
            pytest.skip("the kernel does not allow namespaces here; the audit hook is tested")

    return run


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    path = tmp_path / "truth.json"
    path.write_text("coulomb_friction")
    path.chmod(0o644)
    return path


def test_what_is_honest_works(inside: Run, tmp_path: Path) -> None:
    ended = inside(
        "import sys, numpy, diagnosis.command\n"
        "case, out = [p for p in __import__('json').load(open(sys.argv[1]))['allowed'][:2]]\n"
        "open(out + '/verdict.json', 'w').write(open(case + '/log.mcap').read())\n"
    )
    assert ended.code == 0, ended.said
    assert (tmp_path / "out" / "verdict.json").read_text() == "signals"


@pytest.mark.parametrize(
    "program",
    [
        "import withheld",
        "from fake_robot import robot",
        "import sys; sys.meta_path.clear(); import withheld.plan",
        "import sys, importlib.util as u; sys.meta_path.pop(0); u.find_spec('withheld.plan').loader.load_module()",
        "import runpy; runpy.run_module('withheld.cases.draw')",
    ],
)
def test_the_generator_cannot_be_imported(inside: Run, program: str) -> None:
    ended = inside(program)
    assert ended.code != 0
    assert "withheld" in ended.said or "fake_robot" in ended.said


@pytest.mark.parametrize(
    "program",
    [
        "print(open({path!r}).read())",
        "from pathlib import Path; print(Path({path!r}).read_text())",
        "import os; print(os.read(os.open({path!r}, 0), 99))",
        "import os; os.symlink({path!r}, {out!r} + '/x'); print(open({out!r} + '/x').read())",
        "import os; print(os.read(os.open({case!r} + '/../truth.json', 0), 99))",
        "import subprocess; print(subprocess.check_output(['cat', {path!r}]))",
        "import os; os.system('cat ' + {path!r})",
        "import shutil; shutil.copyfile({path!r}, {out!r} + '/x'); print(open({out!r} + '/x').read())",
    ],
)
def test_the_truth_cannot_be_read(inside: Run, level: Level, truth: Path, tmp_path: Path, program: str) -> None:
    case, out = ("/case", "/out") if level == "namespaces" else (str(tmp_path / "case"), str(tmp_path / "out"))
    ended = inside(program.format(path=str(truth), case=case, out=out))
    assert ended.code != 0
    assert "coulomb_friction" not in ended.said


@pytest.mark.parametrize("name", ["environ", "cmdline", "mem", "maps", "root/etc/hostname"])
def test_the_parent_cannot_be_read(inside: Run, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SPOT_RL_SECRET_SEED", "4711")
    for parent in ("os.getppid()", str(os.getpid())):
        ended = inside(f"import os; print(open(f'/proc/{{{parent}}}/{name}', 'rb').read(99999))")
        assert ended.code != 0
        assert "4711" not in ended.said


def test_nothing_of_the_parents_environment_comes_in(inside: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SPOT_RL_SECRET_SEED", "4711")
    ended = inside("import os; print(dict(os.environ)); print('end')")
    assert ended.code == 0
    assert "4711" not in ended.said


@pytest.mark.parametrize("target", ["127.0.0.1", "::1"])
def test_there_is_no_network(inside: Run, target: str) -> None:
    ended = inside(f"import socket; socket.create_connection(({target!r}, 80), 1)")
    assert ended.code != 0
    assert REFUSED in ended.said


def test_other_folders_cannot_be_listed(inside: Run) -> None:
    for program in ("import os; print(os.listdir('/'))", "from pathlib import Path; print(list(Path('..').iterdir()))"):
        ended = inside(program)
        assert ended.code != 0
        assert REFUSED in ended.said


def test_the_hook_cannot_be_taken_off(inside: Run, truth: Path) -> None:
    ended = inside(f"import sys, __main__\nsys.addaudithook(lambda *_: None)\nprint(open({str(truth)!r}).read())")
    assert ended.code != 0
    assert "coulomb_friction" not in ended.said


NATIVE = """
import ctypes
libc = ctypes.CDLL(None)
buffer = ctypes.create_string_buffer(99)
number = libc.open({path!r}, 0)
print('read', libc.read(number, buffer, 99), buffer.value)
"""


def test_native_code_finds_nothing_in_namespaces(tmp_path: Path, truth: Path) -> None:
    """What the audit hook cannot see, the mount namespace does not have."""
    case, out = tmp_path / "case", tmp_path / "out"
    case.mkdir()
    out.mkdir()
    for path in (truth, Path("/proc/1/environ"), Path(f"/proc/{os.getpid()}/cmdline")):
        try:
            ended = run_locked_in(case, out, (), "namespaces", 60.0, NATIVE.format(path=str(path).encode()))
        except JailError:
            pytest.skip("the kernel does not allow namespaces here")
        assert "read -1" in ended.said, path


def test_files_inside_have_one_age(inside: Run, tmp_path: Path) -> None:
    inside("pass")
    ages = {p.stat().st_mtime for p in (tmp_path / "case").rglob("*")}
    assert ages == {0.0}


def test_the_strongest_level_is_one_that_works() -> None:
    assert strongest_level() in LEVELS
