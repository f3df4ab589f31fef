"""Run the diagnosis where it cannot reach the truth: the outside of :mod:`withheld.blind.inside`."""

from __future__ import annotations

import ctypes
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from spot_model.errors import SpotRlError
from withheld.blind import inside

Level = Literal["namespaces", "other user", "audit hook"]
LEVELS: Final[tuple[Level, ...]] = ("namespaces", "other user", "audit hook")
MEANING: Final[dict[Level, str]] = {
    "namespaces": "own mount, process, network and IPC namespaces: no other file or process exists for it",
    "other user": "another user without rights to the generator's files and processes, and an audit hook",
    "audit hook": "an audit hook alone: code that means to cheat through native calls is not held",
}
NOBODY: Final = 65534
BANNED: Final = ("withheld", "fake_robot")
INSIDE: Final = Path(inside.__file__).parent
OURS: Final = ("diagnosis", "trainer", "spot_model", "spot_log", "spot_runtime", "spot_protos")
"""What exists inside of our packages."""
SYSTEM: Final = ("/usr", "/lib", "/lib64", "/bin", "/sbin", "/etc/ld.so.cache", "/etc/localtime")
HARDWARE: Final = ("/proc/cpuinfo", "/proc/meminfo", "/sys/devices/system/cpu")
"""Read by libraries that look up cores and instruction sets."""
DUMPABLE: Final = 4
PROBE: Final = """
import json, sys
import diagnosis.command, mujoco, numpy, onnxruntime, scipy, sklearn
case, out = json.load(open(sys.argv[1]))["allowed"][:2]
open(out + "/written", "w").write(open(case + "/launch.py").read())
"""


class JailError(SpotRlError):
    """The diagnosing process cannot be locked in."""


@dataclass(frozen=True)
class Ended:
    """A process that ran locked in."""

    code: int
    """124: it ran out of time."""
    said: str
    """The end of what it printed."""
    cpu_s: float


def hide_this_process() -> None:
    """No other process of this user may read this one's memory or environment (prctl PR_SET_DUMPABLE)."""
    ctypes.CDLL(None).prctl(DUMPABLE, 0, 0, 0, 0)


def run_locked_in(
    case: Path, out: Path, words: Sequence[str], level: Level, timeout_s: float, program: str = ""
) -> Ended:
    """Run ``spot-rl diagnose`` with ``words``.

    Args:
        case: Folder with all that it may read; inside, :func:`seen` tells how it is called.
        out: Folder that it may write.
        words: Of the command; paths as they are inside.
        level: How it is locked in.
        timeout_s: After so long it is ended.
        program: Python source to run in place of the diagnosis; for tests.

    Raises:
        JailError: The kernel does not allow this level.
    """
    (case / "launch.py").write_text((INSIDE / "launch.py").read_text(encoding="utf-8"), encoding="utf-8")
    if program:
        (case / "program.py").write_text(program, encoding="utf-8")
    case_inside, out_inside = seen(case, out, level)
    shown, hidden = _shown()
    home = "/home" if level == "namespaces" else out_inside
    allowed = [case_inside, out_inside, "/dev/null", "/dev/urandom", *(inside for _, inside in shown)]
    allowed += [*HARDWARE, *(("/tmp", "/home", "/dev/shm") if level == "namespaces" else ())]  # noqa: S108 - its own
    spec = {
        "path": [*_paths(), _home_of_ours()],
        "banned": BANNED,
        "allowed": allowed,
        "words": list(words),
        "program": f"{case_inside}/program.py" if program else "",
    }
    (case / "words.json").write_text(json.dumps(spec), encoding="utf-8")
    _open_up(case, out)
    command = [sys.executable, "-I", f"{case_inside}/launch.py", f"{case_inside}/words.json"]
    environment = _environment(home)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as scratch:
        options: dict[str, Any] = {"cwd": "/", "env": environment}
        if level == "namespaces":
            root = Path(scratch) / "root"
            root.mkdir()
            entry = {
                "read_only": [*shown, (str(case), case_inside)],
                "hidden": hidden,
                "user": NOBODY,
                "words": command,
                "writable": [(str(out), out_inside)],
                "optional": HARDWARE,
                "root": str(root),
                "environment": environment,
            }
            file = Path(scratch) / "spec.json"
            file.write_text(json.dumps(entry), encoding="utf-8")
            command = [sys.executable, "-I", str(INSIDE / "enter.py"), str(file)]
        elif level == "other user":
            options |= {"user": NOBODY, "group": NOBODY, "extra_groups": []}
        code, said = _run(command, timeout_s, options)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if level == "namespaces" and code == 90:
        raise JailError(f"namespaces cannot be made here: {said.strip()}")
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Ended(code, said, cpu_s)


def seen(case: Path, out: Path, level: Level) -> tuple[str, str]:
    """How the two folders are called inside."""
    return ("/case", "/out") if level == "namespaces" else (str(case.resolve()), str(out.resolve()))


def strongest_level() -> Level:
    """The strongest level at which the diagnosis can be loaded here."""
    for level in LEVELS:
        if level == "other user" and os.getuid() != 0:
            continue
        with tempfile.TemporaryDirectory() as folder:
            case, out = Path(folder) / "case", Path(folder) / "out"
            case.mkdir()
            out.mkdir()
            Path(folder).chmod(0o711)
            try:
                ended = run_locked_in(case, out, (), level, 120.0, PROBE)
            except (JailError, OSError):
                continue
            if ended.code == 0:
                return level
    raise JailError("the diagnosis cannot be started in a process of its own; run `spot-rl diagnose --help` to see why")


def _run(command: Sequence[str], timeout_s: float, options: dict[str, Any]) -> tuple[int, str]:
    try:
        done = subprocess.run(  # noqa: S603 - our own command
            command, capture_output=True, timeout=timeout_s, stdin=subprocess.DEVNULL, check=False, **options
        )
    except subprocess.TimeoutExpired as error:
        return 124, (error.stderr or b"").decode(errors="replace")[-2000:]
    return done.returncode, (done.stdout + done.stderr).decode(errors="replace")[-2000:]


def _environment(home: str) -> dict[str, str]:
    one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "LOKY_MAX_CPU_COUNT"), "1")
    return {"PATH": "/usr/bin:/bin", "HOME": home, "LANG": "C.UTF-8", "MUJOCO_GL": "disable", **one}


def _paths() -> list[str]:
    """Where Python finds the standard library and installed packages; no folder of scripts."""
    prefixes = tuple(f"{p}/" for p in (sys.base_prefix, sys.prefix))
    real = [Path(p).resolve() for p in sys.path if p and Path(p).exists()]
    return [str(p) for p in real if str(p).startswith(prefixes) or next(p.glob("*.dist-info"), None)]


def _shown() -> tuple[list[tuple[str, str]], list[str]]:
    """What exists inside, and folders that appear empty: installed packages, but of ours only what diagnoses."""
    installed = [sys.base_prefix, sys.prefix, *_paths()]
    hidden = {str(banned) for entry in installed for name in BANNED if (banned := Path(entry) / name).is_dir()}
    ours = [f"{_home_of_ours()}/{package}" for package in OURS]
    kept: list[str] = []
    for path in [*(p for p in SYSTEM if Path(p).exists()), *installed, *ours]:
        if not any(path == k or path.startswith(k + "/") for k in kept):
            kept.append(path)
    return [(path, path) for path in kept], sorted(hidden)


def _home_of_ours() -> str:
    """Folder in which our packages lie."""
    return str(Path(__file__).resolve().parent.parent.parent)


def _open_up(case: Path, out: Path) -> None:
    """Readable and writable for the one inside; every file of the same age."""
    for path in (case, *case.rglob("*")):
        path.chmod(0o755 if path.is_dir() else 0o644)
        os.utime(path, (0, 0))
    out.chmod(0o777)
