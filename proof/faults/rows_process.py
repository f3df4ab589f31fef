"""Rows of the process: killed, stopped, out of memory, signalled, unread, twice. All through the command line."""

from __future__ import annotations

import os
import resource
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from proof.faults.drive import read_log
from proof.faults.rig import Rig
from proof.faults.rows import NS_PER_MS, Finding, Row
from spot_log import LogReadError, recover_leftovers
from spot_protos import fake_admin_pb2
from spot_runtime.hal.errors import HalError

END_TIME_MS: Final = 50.0
STOP_BOUND_MS: Final = END_TIME_MS + 5.0
STEP_NS: Final = 1_500_000
PATIENCE_S: Final = 180.0
STUCK_S: Final = 20.0
"""Native libraries that get no memory may wait for ever; the service's watchdog kills such a process after 2 s."""


@dataclass
class Running:
    """A run in a process of its own."""

    process: subprocess.Popen[str]
    folder: Path

    def finish(self, timeout_s: float = PATIENCE_S) -> tuple[int, str]:
        """Wait for the end: exit code and last words. Raises TimeoutExpired when it hangs."""
        _, said = self.process.communicate(timeout=timeout_s)
        return self.process.returncode, said or ""

    def finish_or_kill(self, timeout_s: float = STUCK_S) -> tuple[int, str, bool]:
        """Like :meth:`finish`, but what hangs is killed, as the service's watchdog does; also whether it hung."""
        try:
            return *self.finish(timeout_s), False
        except subprocess.TimeoutExpired:
            self.process.kill()
            return *self.finish(), True


@contextmanager
def running(rig: Rig, *words: str) -> Iterator[Running]:
    """``spot-rl run`` until the policy is in control; whatever happens, it is gone afterwards."""
    folder = rig.new_log_path().with_suffix("")
    command = [sys.executable, "-c", "from spot_model.io.command_line import main; main()", "run"]
    command += ["--robot", rig.address.robot, "--policy", str(rig.policy_file), "--duration", "600"]
    command += ["--log-dir", str(folder), *words]
    command += ["--lock-step", rig.address.admin] if rig.is_lock_step else []
    environment = {**os.environ, **rig.address.environment}
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)  # noqa: S603
    try:
        await_line(process, "→ active")
        rig.truth(reset_extremes=True)
        yield Running(process, folder)
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def await_line(process: subprocess.Popen[str], text: str) -> None:
    """Read what the process says until this comes.

    Raises:
        TimeoutError: It does not come within three minutes, or the process ends.
    """
    deadline_s, said = time.monotonic() + PATIENCE_S, ""
    if process.stderr is None:
        raise TimeoutError("the run's output is not readable")
    descriptor = process.stderr.fileno()
    while text not in said:
        if not select.select([descriptor], [], [], max(0.0, deadline_s - time.monotonic()))[0]:
            raise TimeoutError(f"the run never said {text!r}: {said[-300:]}")
        chunk = os.read(descriptor, 65536).decode(errors="replace")
        if not chunk:
            raise TimeoutError(f"the run ended before it said {text!r}: {said[-300:]}")
        said += chunk


def robot_stops_ms(rig: Rig, before_ns: int) -> float:
    """Time until joint control is over, with no help from the runtime.

    In lock-step, robot time stands still once the runtime does; in real time it counts from just before.
    """
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


def log_is_whole(folder: Path, finding: Finding) -> None:
    """Every log there opens, after recovery where it was cut."""
    try:
        recover_leftovers(folder)
        logs = [path for path in folder.iterdir() if path.name.endswith((".mcap", ".active"))]
    except (OSError, LogReadError) as error:
        finding.log_ok = False
        finding.problems.append(str(error))
        return
    opened = [read_log(path)[0] for path in logs]
    finding.log_ok = bool(opened) and all(log is not None and len(log.states) > 0 for log in opened)


def gone(*signals: signal.Signals, with_logger: bool = False) -> Callable[[Rig], Finding]:
    """The runtime is gone from one instant to the next; the robot stops by itself, and a restart moves nothing."""

    def attempt(rig: Rig) -> Finding:
        finding = Finding("the robot stops by itself")
        with running(rig) as run:
            children = child_ids(run.process.pid)
            before_ns = rig.status().robot_stamp_ns
            for number in signals:
                run.process.send_signal(number)
            for child in children if with_logger else []:
                os.kill(child, signal.SIGKILL)
            settle(rig)
            finding.reaction_ms = robot_stops_ms(rig, before_ns)
            run.process.kill()
            run.process.wait()
            time.sleep(0.3)  # the logger sees the end, and closes its file
            log_is_whole(run.folder, finding)
            rig.step(0.2)
            commands = rig.status().commands_received
            restart(rig, finding)
            finding.demand(rig.status().commands_received == commands, "commands were sent that nobody asked for")
        return finding

    return attempt


def settle(rig: Rig) -> None:
    """In lock-step, wait until the process stands still, so that robot time does."""
    if rig.is_lock_step:
        time.sleep(0.05)


def restart(rig: Rig, finding: Finding) -> None:
    """A client reaches the robot again, and nothing moves by that."""
    rig.step(6.0)
    try:
        with rig.environment():
            rig.clear_behavior_faults()
    except HalError as error:
        finding.problems.append(f"it cannot be reached again: {error}")


def child_ids(process_id: int) -> list[int]:
    """The processes that a process has started."""
    path = Path(f"/proc/{process_id}/task/{process_id}/children")
    return [int(word) for word in path.read_text(encoding="ascii").split()]


def held(rig: Rig) -> Finding:
    """The runtime stands still for a second, then goes on: it stops, and does not go on walking."""
    finding = Finding("the robot stops by itself")
    with running(rig) as run:
        before_ns = rig.status().robot_stamp_ns
        run.process.send_signal(signal.SIGSTOP)
        settle(rig)
        finding.reaction_ms = robot_stops_ms(rig, before_ns)
        rig.step(1.0)
        run.process.send_signal(signal.SIGCONT)
        code, said = run.finish()
        finding.reaction += f", then exit code {code}"
        finding.demand(20 <= code < 80, f"it ended with {code}: {said[-300:]}")
        finding.demand("Traceback" not in said, f"a traceback: {said[-600:]}")
        log_is_whole(run.folder, finding)
    return finding


def limited(
    what: int, room: Callable[[int], int], *, then: signal.Signals = signal.SIGTERM
) -> Callable[[Rig], Finding]:
    """The system grants the runtime nothing more of something; then it is told to stop."""

    def attempt(rig: Rig) -> Finding:
        with running(rig) as run:
            limit = room(run.process.pid)
            resource.prlimit(run.process.pid, what, (limit, limit))
            time.sleep(1.0)
            if run.process.poll() is None:
                run.process.send_signal(then)
            code, said, is_stuck = run.finish_or_kill()
            finding = Finding(f"exit code {code}")
            finding.demand("Traceback" not in said, f"a traceback: {said[-600:]}")
            if not 0 <= code < 100:
                finding.reaction = (
                    "stuck, killed; the robot stops by itself" if is_stuck else "the robot stops by itself"
                )
                finding.reaction_ms = robot_stops_ms(rig, rig.status().robot_stamp_ns)
            log_is_whole(run.folder, finding)
        return finding

    return attempt


def address_space(process_id: int) -> int:
    """What a process has mapped already, bytes."""
    pages = int(Path(f"/proc/{process_id}/statm").read_text(encoding="ascii").split()[0])
    return pages * resource.getpagesize()


def signalled(number: signal.Signals, code: int, *, closes_output: bool = False) -> Callable[[Rig], Finding]:
    """A signal ends the run, the robot sits, and the exit code says why."""

    def attempt(rig: Rig) -> Finding:
        with running(rig) as run:
            if closes_output:
                for pipe in (run.process.stdout, run.process.stderr):
                    if pipe is not None:
                        pipe.close()
            run.process.send_signal(number)
            ended = run.process.wait(PATIENCE_S)
            finding = Finding(f"exit code {ended}")
            finding.demand(ended == code, f"it ended with {ended}, not {code}")
            finding.demand(rig.status().motor_power.lower().endswith("off"), "the motors still have power")
            log_is_whole(run.folder, finding)
            if not closes_output:
                finding.demand("Traceback" not in run.finish()[1], "a traceback")
            else:
                run.process.stdout = run.process.stderr = None
        return finding

    return attempt


def second(rig: Rig) -> Finding:
    """A second runtime of this computer is refused; the first does not notice."""
    with running(rig) as first:
        arguments = [str(word) for word in first.process.args]  # type: ignore[union-attr]
        environment = {**os.environ, **rig.address.environment}
        began_s = time.monotonic()
        other = subprocess.run(  # noqa: S603
            arguments, env=environment, capture_output=True, text=True, timeout=PATIENCE_S, check=False
        )
        finding = Finding(f"exit code {other.returncode}", (time.monotonic() - began_s) * 1e3)
        finding.demand(other.returncode == 94, f"the second ended with {other.returncode}: {other.stderr[-300:]}")
        finding.demand(first.process.poll() is None, "the first ended, too")
        first.process.send_signal(signal.SIGTERM)
        code, said = first.finish()
        finding.demand(code == 10, f"the first ended with {code}: {said[-300:]}")
        log_is_whole(first.folder, finding)
    return finding


ROWS = (
    Row("kill −9 (or the system, out of memory)", STOP_BOUND_MS, gone(signal.SIGKILL), is_real_time=True),
    Row("kill −9 of runtime and logger", STOP_BOUND_MS, gone(signal.SIGKILL, with_logger=True), is_real_time=True),
    Row("SIGSTOP, and on after a second", STOP_BOUND_MS, held, is_real_time=True),
    Row("no more memory", STOP_BOUND_MS, limited(resource.RLIMIT_AS, address_space)),
    Row("no more files", STOP_BOUND_MS, limited(resource.RLIMIT_NOFILE, lambda _: 8)),
    Row("SIGTERM", 0.0, signalled(signal.SIGTERM, 10), is_real_time=True),
    Row("SIGINT", 0.0, signalled(signal.SIGINT, 10)),
    Row("SIGHUP", 0.0, signalled(signal.SIGHUP, 10)),
    Row("SIGTERM, and nobody reads the output", 0.0, signalled(signal.SIGTERM, 10, closes_output=True)),
    Row("a second runtime", 10_000.0, second, is_host_time=True),
)
