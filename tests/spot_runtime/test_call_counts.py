"""What the hot paths may cost, in calls of functions: a count is the same on any computer, however busy.

Each bound is about a third above the count beside it. Whoever passes one has made the path longer: say so by raising
it, and measure (`spot-rl bench all`).
"""

from __future__ import annotations

import socket
import sys
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

from spot_log.format.records import RunHeader, WireState
from spot_log.format.vendor_state import robot_state_from_wire
from spot_log.read.reader import read_run
from spot_log.write.logger_process import LoggerProcess
from spot_log.write.run_writer import RunWriter
from spot_model.policy.policy import Policy
from spot_model.robot.state import JointCommand
from spot_runtime.control.modes import Mode
from spot_runtime.hal.spot.command_stream import CommandEncoder
from tests.spot_runtime.log.conftest import SyntheticRun
from tests.spot_runtime.log.test_wire_columns import state
from tests.spot_runtime.test_loop import drive_until, make_loop


def calls(function: Callable[[], Any]) -> int:
    """How many functions, Python's and C's, one call of ``function`` calls."""
    count = 0

    def note(frame: Any, event: str, argument: Any) -> None:
        nonlocal count
        count += event in {"call", "c_call"}

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        function()
    finally:
        sys.setprofile(before)
    return count


def test_a_cycle_of_the_loop(robot: Any, zero_policy: Policy) -> None:
    loop, sink = make_loop(robot, zero_policy)
    drive_until(loop, Mode.ACTIVE)
    with_tick, without = [], []
    for _ in range(70):
        n = len(sink.ticks)
        cost = calls(loop.cycle)
        (with_tick if len(sink.ticks) > n else without).append(cost)
    assert len(with_tick) >= 9
    assert median(with_tick) < 480  # 370
    assert median(without) < 300  # 229
    assert sum(with_tick + without) / 70 < 430  # 330: before some cycles the next step is warmed up


def test_a_state_handed_to_the_log() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    sink = LoggerProcess(None, ours, Path("unused"))  # type: ignore[arg-type]
    wire = state(1).SerializeToString()
    assert calls(lambda: sink.put(WireState(wire, 1))) < 12  # 9
    assert theirs.recv(1 << 20).endswith(wire)
    ours.close()
    theirs.close()


def test_a_state_decoded_for_the_loop() -> None:
    message = SyntheticRun().message(3)
    assert len(message.inertial_state.packets) == 3
    wire = message.SerializeToString()
    assert calls(lambda: robot_state_from_wire(wire, 1)) < 35  # 26: the inertial unit's packets wait


def test_a_command_encoded(robot: Any, zero_policy: Policy) -> None:
    loop, _ = make_loop(robot, zero_policy)
    drive_until(loop, Mode.ACTIVE)
    command: JointCommand = robot.sent[-1]
    encoder = CommandEncoder("test", 40.0)
    encoder.encode(command, 1)
    assert calls(lambda: encoder.encode(command, 2)) < 10  # 7


def test_a_state_read_from_a_log(tmp_path: Path) -> None:
    n = 2000
    path = tmp_path / "run.mcap"
    writer = RunWriter(path, RunHeader("run", 1), for_viewers=False)
    for i in range(n):
        writer.add(state(i % 7, robot_stamp_ns=1_700_000_000_000_000_000 + 3_000_000 * i), i)
    writer.close({}, "completed")
    assert len(read_run(path).states) == n
    assert calls(lambda: read_run(path)) / n < 24  # 17
