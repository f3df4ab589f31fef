"""Rows of the process: killed, stopped, out of memory, signalled, unread, twice. All through the command line."""

from __future__ import annotations

import os
import resource
import select
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from proof.faults.rows import NS_PER_MS, Finding, Row
from proof.rig import Rig, read_log
from spot_log import LogReadError, recover_leftovers
from spot_model.process.child_process import HEARD, ChildProcess
from spot_protos import fake_admin_pb2
from spot_runtime.hal.errors import HalError

STOP_BOUND_MS: Final = 55.0
"""The end time of a command, and the link's few milliseconds."""
STEP_NS: Final = 1_500_000
PATIENCE_S: Final = 180.0
STUCK_S: Final = 8.0
"""Native libraries that get no memory may wait for ever; the service's watchdog kills such a process after 2 s."""


@dataclass
class Running:
    """A run in a process of its own."""

    process: ChildProcess
    folder: Path
    words: Sequence[str] = ()
    """Its command line."""

    def finish(self, timeout_s: float = PATIENCE_S) -> tuple[int, str, bool]:
        """Exit code, last words, and whether it hung: then it is killed, as the service's watchdog does."""
        code, said = self.process.hear_out(timeout_s)
        is_stuck = code is None
        if is_stuck:
            self.process.kill()
            code, said = self.process.hear_out(PATIENCE_S)
        return code or 0, said.decode(errors="replace"), is_stuck


@contextmanager
def running(rig: Rig) -> Iterator[Running]:
    """Start ``spot-rl run`` and wait until the policy is in control; whatever happens, it is gone afterwards."""
    folder = rig.new_log_path().with_suffix("")
    words = ["run", "--robot", rig.address.robot, "--policy", str(rig.policy_file), "--duration", "600"]
    words += ["--log-dir", str(folder), "--ca-file", str(rig.address.ca_file)]
    words += ["--credentials-file", str(rig.credentials_file)]
    words += ["--lock-step", rig.address.admin] if rig.is_lock_step else []
    process = start(words)
    try:
        await_line(process, "→ active")
        rig.truth(reset_extremes=True)
        yield Running(process, folder, words)
    finally:
        process.end(0.0)


def start(words: Sequence[str]) -> ChildProcess:
    """Start ``spot-rl`` with these words."""
    return ChildProcess.start("spot_model", *words, told=b"", output=HEARD, errors=subprocess.STDOUT)


def await_line(process: ChildProcess, text: str) -> None:
    """Read what the process says until this comes.

    Raises:
        TimeoutError: It does not come within three minutes, or the process ends.
    """
    deadline_s, said = time.monotonic() + PATIENCE_S, ""
    descriptor = process.output.fileno()
    while text not in said:
        has_words = select.select([descriptor], [], [], max(0.0, deadline_s - time.monotonic()))[0]
        chunk = os.read(descriptor, 65536).decode(errors="replace") if has_words else ""
        if not chunk:
            raise TimeoutError(f"the run ended, or never said {text!r}: {said[-300:]}")
        said += chunk


def stops_ms(rig: Rig, before_ns: int) -> float:
    """Wait until joint control is over, with no help from the runtime. Returns how long that takes, ms.

    In lock-step, robot time stands still once the runtime does; in real time it counts from ``before_ns``.
    """
    if rig.is_lock_step:
        time.sleep(0.05)  # until the process stands still
    began_ns = rig.status().robot_stamp_ns if rig.is_lock_step else before_ns
    for _ in range(1000):
        status = rig.status()
        if "joint_control" not in status.mode.lower():
            return float(status.robot_stamp_ns - began_ns) / NS_PER_MS
        if rig.is_lock_step:
            rig.admin.Step(fake_admin_pb2.StepRequest(duration_ns=STEP_NS))
        else:
            time.sleep(0.0005)
    return float("inf")


def check_words(said: str, finding: Finding) -> None:
    """Check that what a process said holds no traceback."""
    finding.demand("Traceback" not in said, f"a traceback: {said[-600:]}")


def check_logs(folder: Path, finding: Finding) -> None:
    """Check that every log there opens, after recovery where it was cut."""
    try:
        recover_leftovers(folder)
        logs = [path for path in folder.iterdir() if path.name.endswith((".mcap", ".active"))]
    except (OSError, LogReadError) as error:
        finding.log_ok = False
        finding.problems.append(str(error))
        return
    opened = [read_log(path)[0] for path in logs]
    finding.log_ok = bool(opened) and all(log is not None and len(log.states) > 0 for log in opened)


def killed(rig: Rig, *, with_logger: bool) -> Finding:
    """End the runtime from one instant to the next: the robot stops by itself, and a restart moves nothing."""
    finding = Finding("the robot stops by itself")
    with running(rig) as run:
        children = Path(f"/proc/{run.process.pid}/task/{run.process.pid}/children").read_text(encoding="ascii")
        before_ns = rig.status().robot_stamp_ns
        run.process.kill()
        for child in children.split() if with_logger else []:
            os.kill(int(child), signal.SIGKILL)
        finding.reaction_ms = stops_ms(rig, before_ns)
        run.process.wait(PATIENCE_S)
        time.sleep(0.3)  # the logger sees the end, and closes its file
        check_logs(run.folder, finding)
        rig.step(0.2)
        commands = rig.status().commands_received
        rig.step(6.0)
        try:
            rig.clear_behavior_faults()
        except HalError as error:
            finding.problems.append(f"it cannot be reached again: {error}")
        finding.demand(rig.status().commands_received == commands, "commands were sent that nobody asked for")
    return finding


def held(rig: Rig) -> Finding:
    """Let the runtime stand still for a second, then go on: it stops, and does not go on walking."""
    finding = Finding("the robot stops by itself")
    with running(rig) as run:
        before_ns = rig.status().robot_stamp_ns
        run.process.send(signal.SIGSTOP)
        finding.reaction_ms = stops_ms(rig, before_ns)
        rig.step(1.0)
        run.process.send(signal.SIGCONT)
        code, said, _ = run.finish()
        finding.reaction += f", then exit code {code}"
        finding.demand(16 <= code < 80, f"it ended with {code}: {said[-300:]}")
        # In lock-step a process may take its time, so its pauses are not watched.
        is_told = rig.is_lock_step or "this process did not run" in said
        finding.demand(is_told, f"it does not say that it did not run: {said[-300:]}")
        check_words(said, finding)
        check_logs(run.folder, finding)
    return finding


def limited(rig: Rig, what: int, room: Callable[[int], int]) -> Finding:
    """Grant the runtime nothing more of something, then tell it to stop."""
    with running(rig) as run:
        limit = room(run.process.pid)
        resource.prlimit(run.process.pid, what, (limit, limit))
        time.sleep(1.0)
        run.process.send(signal.SIGTERM)
        code, said, is_stuck = run.finish(STUCK_S)
        finding = Finding(f"exit code {code}")
        check_words(said, finding)
        if not 0 <= code < 100:
            finding.reaction = "stuck, killed; the robot stops by itself" if is_stuck else "the robot stops by itself"
            finding.reaction_ms = stops_ms(rig, rig.status().robot_stamp_ns)
        check_logs(run.folder, finding)
    return finding


def mapped_bytes(process_id: int) -> int:
    """Return what a process has mapped already."""
    pages = int(Path(f"/proc/{process_id}/statm").read_text(encoding="ascii").split()[0])
    return pages * resource.getpagesize()


def signalled(rig: Rig, number: signal.Signals, *, closes_output: bool = False) -> Finding:
    """Send a signal: it ends the run, the robot sits, and the exit code says why."""
    with running(rig) as run:
        if closes_output:
            run.process.output.close()
        run.process.send(number)
        code, said = (run.process.wait(PATIENCE_S), b"") if closes_output else run.process.hear_out(PATIENCE_S)
        finding = Finding(f"exit code {code}")
        finding.demand(code == 10, f"it ended with {code}, not 10")
        check_words(said.decode(errors="replace"), finding)
        finding.demand(not rig.is_powered, "the motors still have power")
        check_logs(run.folder, finding)
    return finding


def second(rig: Rig) -> Finding:
    """Start a second runtime on this computer: it is refused, and the first does not notice."""
    with running(rig) as first:
        began_s = time.monotonic()
        with start(first.words) as other:
            refused, told = other.hear_out(PATIENCE_S)
        finding = Finding(f"exit code {refused}", (time.monotonic() - began_s) * 1e3)
        finding.demand(refused == 94, f"the second ended with {refused}: {told[-300:]!r}")
        finding.demand(first.process.exit_code is None, "the first ended, too")
        first.process.send(signal.SIGTERM)
        code, said, _ = first.finish()
        finding.demand(code == 10, f"the first ended with {code}: {said[-300:]}")
        check_logs(first.folder, finding)
    return finding


no_memory = partial(limited, what=resource.RLIMIT_AS, room=mapped_bytes)
no_files = partial(limited, what=resource.RLIMIT_NOFILE, room=lambda _: 8)
unread = partial(signalled, number=signal.SIGTERM, closes_output=True)

ROWS = (
    Row("kill −9 (or the system, out of memory)", STOP_BOUND_MS, partial(killed, with_logger=False), is_real_time=True),
    Row("kill −9 of runtime and logger", STOP_BOUND_MS, partial(killed, with_logger=True), is_real_time=True),
    Row("SIGSTOP, and on after a second", STOP_BOUND_MS, held, is_real_time=True),
    Row("no more memory", STOP_BOUND_MS, no_memory),
    Row("no more files", STOP_BOUND_MS, no_files),
    *(
        Row(number.name, 0.0, partial(signalled, number=number), is_real_time=number == signal.SIGTERM)
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
    ),
    Row("SIGTERM, and nobody reads the output", 0.0, unread),
    Row("a second runtime", 10_000.0, second, is_host_time=True),
)
