"""Run the diagnosis in a process that cannot reach the truth: in namespaces of its own, and under an audit hook.

The namespaces are made by util-linux (``unshare``, ``mount``, ``setpriv``) and coreutils (``chroot``).
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from spot_model.errors import SpotRlError

Level = Literal["namespaces", "audit hook"]
MEANING: Final[dict[Level, str]] = {
    "namespaces": "own mount, process, network and IPC namespaces: no other file or process exists for it",
    "audit hook": "an audit hook alone: code that means to cheat through native calls is not held",
}
"""The strongest first."""
NOBODY: Final = 65534
BANNED: Final = ("withheld", "fake_robot")
LAUNCH: Final = Path(__file__).with_name("launch.py")
HOME_OF_OURS: Final = Path(__file__).resolve().parents[2]
"""Folder in which our packages lie."""
OURS: Final = ("diagnosis", "trainer", "spot_model", "spot_log", "spot_runtime", "spot_protos")
"""What exists inside of our packages."""
SYSTEM: Final = ("/usr", "/lib", "/lib64", "/bin", "/sbin", "/etc/ld.so.cache", "/etc/localtime")
HARDWARE: Final = ("/proc/cpuinfo", "/proc/meminfo", "/sys/devices/system/cpu")
"""Read by libraries that look up cores and instruction sets."""
DEVICES: Final = ("/dev/null", "/dev/zero", "/dev/random", "/dev/urandom")
SCRATCH: Final = ("/tmp", "/home", "/dev/shm")  # noqa: S108 - empty ones of the namespace's own
DUMPABLE: Final = 4
TIMED_OUT: Final = 124
PROBE: Final = """
import json, sys
import diagnosis.command, mujoco, numpy, onnxruntime, scipy
case, out = json.load(open(sys.argv[1]))["allowed"][:2]
open(out + "/written", "w").write(open(case + "/launch.py").read())
"""


class JailError(SpotRlError):
    """The diagnosing process cannot be started."""


@dataclass(frozen=True)
class Ended:
    """A process that ran locked in."""

    code: int
    """:data:`TIMED_OUT`: it ran out of time."""
    said: str
    """The end of what it printed."""
    cpu_s: float


def hide_this_process() -> None:
    """Keep other processes of this user from reading this one's memory and environment (prctl PR_SET_DUMPABLE)."""
    ctypes.CDLL(None).prctl(DUMPABLE, 0, 0, 0, 0)


def seen(case: Path, out: Path, level: Level) -> tuple[str, str]:
    """Return what the two folders are called inside."""
    return ("/case", "/out") if level == "namespaces" else (str(case.resolve()), str(out.resolve()))


def strongest_level() -> Level:
    """Return the strongest level at which the diagnosis can be loaded here.

    Raises:
        JailError: There is none.
    """
    for level in MEANING:
        with tempfile.TemporaryDirectory() as folder:
            case, out = Path(folder) / "case", Path(folder) / "out"
            case.mkdir()
            out.mkdir()
            if run_locked_in(case, out, (), level, 120.0, PROBE).code == 0:
                return level
    raise JailError("the diagnosis cannot be started in a process of its own; run `spot-rl diagnose --help` to see why")


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
        program: Python source to run in place of the diagnosis.
    """
    case_inside, out_inside = seen(case, out, level)
    shown, hidden = _shown(), _hidden()
    own = (*HARDWARE, *DEVICES, *(SCRATCH if level == "namespaces" else ()))
    spec = {
        "path": [*_paths(), str(HOME_OF_OURS)],
        "banned": BANNED,
        "allowed": [case_inside, out_inside, *shown, *own],
        "hidden": hidden,
        "words": list(words),
        "program": f"{case_inside}/program.py" if program else "",
    }
    (case / "launch.py").write_bytes(LAUNCH.read_bytes())
    (case / "words.json").write_text(json.dumps(spec), encoding="utf-8")
    if program:
        (case / "program.py").write_text(program, encoding="utf-8")
    # Readable and writable for whoever is inside; every file of the same age.
    for path in (case, *case.rglob("*")):
        path.chmod(0o755 if path.is_dir() else 0o644)
        os.utime(path, (0, 0))
    out.chmod(0o777)
    command = [sys.executable, "-I", f"{case_inside}/launch.py", f"{case_inside}/words.json"]
    environment = {
        "PATH": "/usr/bin:/bin:/usr/sbin:/sbin",
        "HOME": "/home" if level == "namespaces" else out_inside,
        "LANG": "C.UTF-8",
        "MUJOCO_GL": "disable",
        **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "LOKY_MAX_CPU_COUNT"), "1"),
    }
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as root:
        if level == "namespaces":
            command = _in_namespaces(
                command, Path(root), [*((path, path) for path in shown), (str(case), "/case")], out
            )
        try:
            done = subprocess.run(  # noqa: S603 - our own command
                command,
                capture_output=True,
                timeout=timeout_s,
                stdin=subprocess.DEVNULL,
                check=False,
                cwd="/",
                env=environment,
            )
            code, said = done.returncode, done.stdout + done.stderr
        except subprocess.TimeoutExpired as error:
            code, said = TIMED_OUT, error.stderr or b""
        except OSError as error:
            code, said = 1, str(error).encode()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Ended(code, said.decode(errors="replace")[-2000:], cpu_s)


def _in_namespaces(command: Sequence[str], root: Path, shown: Sequence[tuple[str, str]], out: Path) -> list[str]:
    """Return a command that runs another one where nothing exists but a few folders, without any privilege.

    Args:
        command: As it is inside.
        root: An empty folder to build on.
        shown: What can be read: paths outside and inside.
        out: What can be written as ``/out``.
    """
    quote = shlex.quote
    lines = [
        "set -e",
        "umask 022",
        f"cd {quote(str(root))}",
        "mount -t tmpfs -o mode=755,nosuid,nodev tmpfs .",
        'cd "$PWD"',
    ]
    lines += [f"mkdir -p -m 777 .{path}" for path in SCRATCH]

    def show(source: str, inside: str, *, is_writable: bool = False) -> str:
        """Bind a path; where a namespace may not make it read-only, the permissions outside protect it."""
        place = quote(f".{inside}")
        make = f"mkdir -p {place}" if Path(source).is_dir() else f"mkdir -p $(dirname {place}) && touch {place}"
        bind = f"{make} && mount --rbind {quote(source)} {place}"
        return bind if is_writable else f"{bind} && {{ mount -o remount,bind,ro,nosuid {place} 2>/dev/null || true; }}"

    lines += [show(source, inside) for source, inside in shown]
    lines += [f"{{ {show(path, path)}; }} 2>/dev/null || true" for path in HARDWARE]
    lines += [f"mount -t tmpfs -o ro,mode=000,size=4k tmpfs {quote('.' + path)}" for path in _hidden()]
    lines += [show(path, path, is_writable=True) for path in DEVICES]
    lines += [show(str(out), "/out", is_writable=True)]
    user, becomes = ["--user", "--map-root-user"], ""
    if os.getuid() == 0:
        user, becomes = [], f"--reuid {NOBODY} --regid {NOBODY} --clear-groups "
    # Without privileges nobody leaves a changed root: the kernel then also refuses new user namespaces.
    drop = f"setpriv {becomes}--no-new-privs --bounding-set=-all --inh-caps=-all"
    lines += [f"exec chroot . {drop} {shlex.join(command)}"]
    apart = ["unshare", *user, "--mount", "--uts", "--ipc", "--net", "--pid", "--fork", "--kill-child"]
    return ["setpriv", "--pdeathsig", "KILL", *apart, "sh", "-c", "\n".join(lines)]


def _paths() -> list[str]:
    """Return where Python finds the standard library and installed packages; no folder of scripts."""
    prefixes = tuple(f"{p}/" for p in (sys.base_prefix, sys.prefix))
    real = [Path(p).resolve() for p in sys.path if p and Path(p).exists()]
    return [str(p) for p in real if str(p).startswith(prefixes) or next(p.glob("*.dist-info"), None)]


def _shown() -> list[str]:
    """Return what exists inside: the system, installed packages, and of ours only what diagnoses."""
    ours = [f"{HOME_OF_OURS}/{package}" for package in OURS]
    kept: list[str] = []
    for path in [*(p for p in SYSTEM if Path(p).exists()), sys.base_prefix, sys.prefix, *_paths(), *ours]:
        if not any(path == k or path.startswith(k + "/") for k in kept):
            kept.append(path)
    return kept


def _hidden() -> list[str]:
    """Return folders within these that appear empty: installed packages of ours that know the truth's formulas."""
    installed = [sys.base_prefix, sys.prefix, *_paths()]
    return sorted({str(Path(entry) / name) for entry in installed for name in BANNED if (Path(entry) / name).is_dir()})
