"""Rows of the policy: no numbers, wrong scale, jumps, too slow, an error, another shape, another file."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proof.faults.faulty_hal import FaultyHal
from proof.faults.rig import Rig
from proof.faults.rows import Finding, Row, judge, reacted, tried_with, went_on
from spot_model.io.velocity_sequence import standing_sequence
from spot_model.policy.contract import PolicyError
from spot_model.policy.policy import Policy, load_policy, policy_from_bytes
from spot_tools.run.scripted import ScriptedSource

Actions = NDArray[np.float32]
FIVE_TICKS_MS = 125.0


@dataclass
class Change:
    """What is done to a network's output."""

    act: Callable[[Actions], Actions] = lambda action: action


@dataclass(frozen=True)
class ChangedPolicy(Policy):
    """A policy whose output is changed once something has happened."""

    change: Change = field(default_factory=Change)

    def act(self, observation: NDArray[Any]) -> Actions:
        """Like the real one, changed. Changes see shape (n, 12)."""
        actions = self.change.act(super().act(np.atleast_2d(observation)))
        return actions[0] if np.ndim(observation) == 1 else actions


def changeable(policy: Policy) -> ChangedPolicy:
    """The same policy, to be changed."""
    return ChangedPolicy(**{part.name: getattr(policy, part.name) for part in fields(policy)})


@tried_with
def wrong(
    rig: Rig, change: Callable[[Actions], Actions], outcome: str | tuple[str, ...], *, cuts: bool = False
) -> Finding:
    """The network's output is changed: cut where it can be, then damping."""
    policy = changeable(rig.policy)
    drive = rig.drive(lambda _: setattr(policy.change, "act", change), policy=policy)
    finding = reacted(drive, judge(drive, outcome), "damping")
    finding.demand(not cuts or drive.event_ns("setpoint_cut") is not None, "nothing was cut before the stop")
    return finding


class Alternating:
    """Adds and takes off the same offset, tick by tick: every set-point jumps."""

    def __init__(self, offset: float) -> None:
        self._offset = np.float32(offset)

    def __call__(self, action: Actions) -> Actions:
        """One tick's action."""
        self._offset = -self._offset
        return action * np.float32(0.0) + self._offset


def broken_network(_: Actions) -> Actions:
    """What a defect in the network's library looks like."""
    raise RuntimeError("the network is broken")


def slow(rig: Rig) -> Finding:
    """The network takes 45 ms of robot time a tick."""
    policy = changeable(rig.policy)

    def act(hal: FaultyHal) -> None:
        def change(action: Actions) -> Actions:
            hal.pace.pause(0.045)
            return action

        policy.change.act = change

    drive = rig.drive(act, policy=policy)
    finding = judge(drive, ("ticks_skipped", "state_stale", "command_refused"))
    way = "damping" if drive.event_ns("damping") is not None else "released"
    return reacted(drive, finding, way)


@tried_with
def not_loaded(rig: Rig, change: Callable[[bytes], bytes]) -> Finding:
    """A file that is not what was exported is refused, in words."""
    finding = Finding("refused to load")
    data = bytes(change(policy_data(rig)))
    try:
        policy_from_bytes(data, source="changed policy")
    except PolicyError as error:
        finding.demand("changed policy" in str(error), f"the error does not name the file: {error}")
    else:
        finding.problems.append("it was loaded")
    return finding


def policy_data(rig: Rig) -> bytes:
    """The file of the rig's policy."""
    return rig.policy_file.read_bytes()


def with_byte_changed(data: bytes) -> bytes:
    """One weight's exponent changed in the middle of the file."""
    changed = bytearray(data)
    changed[len(data) // 2 | 3] ^= 0x7F
    return bytes(changed)


def with_joints_swapped(data: bytes) -> bytes:
    """A joint's name that comes twice."""
    return data.replace(b'"fl_hx"', b'"fr_hx"')


def replaced_file(rig: Rig) -> Finding:
    """The file is replaced while it runs: what was loaded, runs."""
    copy = rig.folder / "replaced.onnx"
    copy.write_bytes(policy_data(rig))
    policy: Policy = load_policy(copy)
    drive = rig.drive(lambda _: replace_by_noise(copy), policy=policy, seconds=2.0)
    finding = went_on(drive, judge(drive, "completed"))
    if drive.log is not None:
        same = drive.log.header.policy_sha256 == hashlib.sha256(policy_data(rig)).hexdigest()
        finding.demand(same, "the log names another digest than that of what ran")
    return finding


def replace_by_noise(path: Path) -> None:
    """Something else under the same name."""
    path.write_bytes(b"noise" * 1000)


FLUNG = ("setpoint_overshoot", "tilt")
"""Whichever bound is met first: at some instants of a step, four ticks at a stop tilt the robot."""

TWO_TICKS = 2
FOUR = 4.0
"""Times the scale of 0.2 rad, that is just beyond the stop of a hip's first joint, 0.785 rad."""


def a_short_overshoot(rig: Rig) -> Finding:
    """One joint beyond its stop for two ticks: cut, told and logged, and the run goes on."""
    policy = changeable(rig.policy)

    class Twice:
        left = TWO_TICKS

        def __call__(self, action: Actions) -> Actions:
            self.left -= 1
            return np.where(np.arange(action.shape[1]) == 0, np.float32(FOUR), action) if self.left >= 0 else action

    def act(_: FaultyHal) -> None:
        policy.change.act = Twice()

    source = ScriptedSource(standing_sequence(), duration_s=3.0)
    drive = rig.drive(act, policy=policy, source=source)
    finding = went_on(drive, judge(drive, "completed"))
    finding.demand(drive.event_ns("setpoint_cut") is not None, "nobody says that it was cut")
    if drive.log is not None:
        commands = drive.log.commands
        asked = np.abs(commands.requested_position_rad - commands.position_rad).max()
        finding.demand(asked > 0.05, "the log does not hold what was asked")
    return finding


ROWS = (
    Row("policy gives NaN", 45.0, wrong(lambda a: a * np.float32(np.nan), "policy_not_finite")),
    Row("policy gives infinity", 45.0, wrong(lambda a: a * 0 + np.float32(np.inf), "policy_not_finite")),
    Row(
        "policy far beyond the stops",
        FIVE_TICKS_MS,
        wrong(lambda a: a * 0 + np.float32(40.0), FLUNG, cuts=True),
    ),
    Row(
        "policy jumps from stop to stop",
        FIVE_TICKS_MS,
        wrong(Alternating(9.0), ("setpoint_step", "joint_velocity", "setpoint_overshoot", "body_low"), cuts=True),
    ),
    Row("policy raises an error", 45.0, wrong(broken_network, "internal_error")),
    Row("policy gives eleven numbers", 45.0, wrong(lambda a: a[:, :11], "internal_error")),
    Row("policy too slow", 500.0, slow),
    Row("policy file with one byte changed", 0.0, not_loaded(with_byte_changed)),
    Row("policy file with a joint named twice", 0.0, not_loaded(with_joints_swapped)),
    Row("policy file cut in half", 0.0, not_loaded(lambda data: data[: len(data) // 2])),
    Row("policy file replaced while running", 0.0, replaced_file),
    Row("policy beyond the stops for two ticks", 0.0, a_short_overshoot),
    Row("policy gives 1e38", 125.0, wrong(lambda a: a * 0 + np.float32(1e38), FLUNG, cuts=True)),
    Row(
        "policy gives minus infinity for one joint",
        45.0,
        wrong(lambda a: np.where(np.arange(a.shape[1]) == 0, np.float32(-np.inf), a), "policy_not_finite"),
    ),
)
