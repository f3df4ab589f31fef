"""What a step leaves in the log: the one place that fills in the records of commands and ticks."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_log.format.records import CommandRecord, TickRecord
from spot_model.robot.stamps import NS_PER_S
from spot_model.robot.state import JointCommand
from spot_runtime.control.memory import NOTHING_ASKED, Step, Tick
from spot_runtime.control.snapshot import Snapshot

_NOTHING: Final[NDArray[np.float32]] = np.zeros(0, dtype=np.float32)


def command_record(step: Step, command: JointCommand, host_ns: int) -> CommandRecord:
    """The command as it was sent at this instant of the host's clock, beside what was requested."""
    state_ns = 0 if step.newest is None else step.newest.robot_stamp_ns
    memory = step.memory
    return CommandRecord(command, memory.drive.requested_rad, host_ns, memory.sent_ns, state_ns)


def state_age_s(tick: Tick, now: Snapshot) -> float:
    """Time from the receipt of a tick's state to the start of the step, s."""
    return (now.host_ns - tick.state.host_stamp_ns) / NS_PER_S


def tick_record(step: Step, tick: Tick, now: Snapshot, compute_s: float) -> TickRecord:
    """The tick with all that the policy saw and gave."""
    memory, result = step.memory, tick.result
    command = memory.drive.command
    return TickRecord(
        index=tick.number,
        robot_stamp_ns=tick.state.robot_stamp_ns,
        host_stamp_ns=now.host_ns,
        mode=memory.phase.mode.value,
        observation=_NOTHING if result is None else result.observation,
        action=_NOTHING if result is None else result.action,
        velocity_command=command if command.shape == NOTHING_ASKED.shape else NOTHING_ASKED,
        state_age_s=state_age_s(tick, now),
        inference_s=tick.inference_s,
        compute_s=compute_s,
        command_key=memory.key,
        skipped=tick.lost,
    )
