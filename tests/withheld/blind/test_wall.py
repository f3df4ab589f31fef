"""A diagnosis that tries to cheat is caught: each way, at each level that this machine allows."""

import json
import os
from pathlib import Path

import pytest

from withheld.blind.jail import MEANING, Level, run_locked_in, seen, strongest_level

SECRETS = ("coulomb_friction", "4711")
"""In the truth's file and in the judge's environment."""
READS = {
    "open": "open(path).read()",
    "pathlib": "Path(path).read_text()",
    "os.open": "os.read(os.open(path, 0), 99)",
    "link": "[os.symlink(path, out + '/x'), open(out + '/x').read()]",
    "dots": "os.read(os.open(case + '/../truth.json', 0), 99)",
    "another program": "subprocess.check_output(['cat', path])",
    "shell": "os.system('cat ' + path)",
    "copy": "[shutil.copyfile(path, out + '/y'), open(out + '/y').read()]",
    "without the hook": "[sys.addaudithook(lambda *_: None), open(path).read()]",
    "a list of the root": "os.listdir('/')",
    "a list of the folder above": "list(Path('..').iterdir())",
    "import": "__import__('withheld.plan')",
    "import of the fake robot": "importlib.import_module('fake_robot.robot')",
    "import without finders": "[sys.meta_path.clear(), __import__('withheld.cases')]",
    "import by a loader": "importlib.util.find_spec('withheld.plan').loader.load_module()",
    "run as a program": "runpy.run_module('withheld.cases')",
    "network": "socket.create_connection(('127.0.0.1', 80), 1)",
    "network of version 6": "socket.create_connection(('::1', 80), 1)",
    **{
        f"{name} of {parent}": f"open(f'/proc/{{{parent}}}/{name}', 'rb').read(99999)"
        for name in ("environ", "cmdline", "mem", "maps", "root/etc/hostname")
        for parent in ("os.getppid()", "judge")
    },
}
ALLOWED = {
    "environment": "dict(os.environ)",
    "a log": "open(case + '/log.mcap').read()",
    "a result": "open(out + '/verdict.json', 'w').write('{}')",
    "libraries": "[__import__('numpy').zeros(1), __import__('diagnosis.command')]",
}
PROGRAM = """
import importlib.util, json, os, runpy, shutil, socket, subprocess, sys
from pathlib import Path
finders, asked = sys.meta_path[:], json.loads({asked!r})
case, out, path, judge = asked.pop("places")
for name, words in asked.items():
    try:
        print(json.dumps([name, True, repr(eval(words))]))
    except BaseException as error:
        print(json.dumps([name, False, repr(error)[:150]]))
    sys.meta_path[:] = finders
"""
NATIVE = """
import ctypes
libc = ctypes.CDLL(None)
print([libc.open(path, 0) for path in {paths!r}], libc.unshare(0x10000000))
"""


def folders(where: Path) -> tuple[Path, Path, Path]:
    case, out, truth = where / "case", where / "out", where / "truth.json"
    case.mkdir()
    out.mkdir()
    (case / "log.mcap").write_text("signals")
    truth.write_text(SECRETS[0])
    truth.chmod(0o644)
    return case, out, truth


@pytest.fixture(scope="module", params=MEANING)
def said(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[bool, str]]:
    """What came of every attempt, in one process: whether it worked, and its result or error."""
    level: Level = request.param
    if level == "namespaces" and strongest_level() != level:
        pytest.skip("no namespaces here; the audit hook is tested")
    case, out, truth = folders(tmp_path_factory.mktemp("wall"))
    places = [*seen(case, out, level), str(truth), os.getpid()]
    program = PROGRAM.format(asked=json.dumps({"places": places, **READS, **ALLOWED}))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SPOT_RL_SECRET_SEED", SECRETS[1])
        # The end of what it prints is kept: few attempts at a time.
        found: dict[str, tuple[bool, str]] = {}
        for names in (list(READS)[:10], list(READS)[10:20], list(READS)[20:], list(ALLOWED)):
            some = {"places": places, **{name: ({**READS, **ALLOWED})[name] for name in names}}
            program = PROGRAM.format(asked=json.dumps(some))
            ended = run_locked_in(case, out, (), level, 120.0, program)
            assert ended.code == 0, ended.said
            found |= {name: (ok, text) for name, ok, text in map(json.loads, ended.said.splitlines())}
    assert {p.stat().st_mtime for p in case.rglob("*")} == {0.0}
    assert (out / "verdict.json").read_text() == "{}"
    return found


@pytest.mark.parametrize("name", READS)
def test_no_way_leads_to_the_truth(said: dict[str, tuple[bool, str]], name: str) -> None:
    has_worked, text = said[name]
    assert not has_worked, text
    assert not any(secret in text for secret in SECRETS)


@pytest.mark.parametrize("name", ALLOWED)
def test_what_is_honest_works(said: dict[str, tuple[bool, str]], name: str) -> None:
    has_worked, text = said[name]
    assert has_worked, text
    assert not any(secret in text for secret in SECRETS)


def test_native_code_finds_nothing_in_namespaces(tmp_path: Path) -> None:
    """What the audit hook cannot see, the mount namespace does not have; and nobody makes another one inside."""
    if strongest_level() != "namespaces":
        pytest.skip("no namespaces here")
    case, out, truth = folders(tmp_path)
    paths = [os.fsencode(p) for p in (truth, "/proc/1/environ", f"/proc/{os.getpid()}/cmdline", "/etc/passwd")]
    ended = run_locked_in(case, out, (), "namespaces", 60.0, NATIVE.format(paths=paths))
    assert ended.said.strip() == "[-1, -1, -1, -1] -1"
