"""Rows of the policy: no numbers, wrong scale, jumps, too slow, an error, another shape, another file."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from itertools import chain, cycle, repeat
from typing import Final

import numpy as np

from proof.faults.attempts import SOFT, Act, is_told, row
from proof.faults.rows import Finding, Row, judge
from proof.faulty import Actions, FaultyHal
from proof.rig import Drive, Rig
from spot_model.io.velocity_sequence import standing_sequence
from spot_model.policy.contract import PolicyError
from spot_model.policy.policy import load_policy, policy_from_bytes
from spot_tools.sources import ScriptedSource

FIVE_TICKS_MS: Final = 125.0
FLUNG: Final = ("setpoint_overshoot", "tilt")
"""Whichever bound is met first: at some instants of a step, four ticks at a stop tilt the robot."""
THROWN_ABOUT: Final = ("setpoint_step", "joint_velocity", "setpoint_overshoot", "body_low")
JUST_BEYOND: Final = 4.0
"""Times the scale of 0.2 rad, that is just beyond the stop of a hip's first joint, 0.785 rad."""
STANDING: Final = ScriptedSource(standing_sequence(), duration_s=3.0)
IS_CUT: Final = is_told("setpoint_cut")


def gives(change: Callable[[Actions], Actions]) -> Act:
    """Make the act from which on the network's output is changed."""

    def act(rig: Rig, _: FaultyHal) -> None:
        rig.policy.change.act = change

    return act


def all_are(value: float) -> Act:
    """Make the act from which on every action has this value."""
    return gives(lambda actions: np.full_like(actions, value))


def first_is(actions: Actions, value: float) -> Actions:
    """Return the same actions, but for the first joint's."""
    return np.where(np.arange(actions.shape[1]) == 0, np.float32(value), actions)


def jumps(rig: Rig, _: FaultyHal) -> None:
    """Let every set-point jump from stop to stop, tick by tick."""
    offsets = cycle((-9.0, 9.0))
    rig.policy.change.act = lambda actions: np.full_like(actions, next(offsets))


def overshoots_twice(rig: Rig, _: FaultyHal) -> None:
    """Send one joint beyond its stop for two ticks."""
    is_wrong = chain((True, True), repeat(False))
    rig.policy.change.act = lambda actions: first_is(actions, JUST_BEYOND) if next(is_wrong) else actions


def breaks(_: Actions) -> Actions:
    """Raise an error, as a defect in the network's library does."""
    raise RuntimeError("the network is broken")


def takes_long(rig: Rig, hal: FaultyHal) -> None:
    """Let the network take 45 ms of robot time a tick."""

    def change(actions: Actions) -> Actions:
        hal.pace.pause(0.045)
        return actions

    rig.policy.change.act = change


def is_logged_as_asked(_: Rig, drive: Drive, finding: Finding) -> None:
    """Check that the log holds what the policy asked for before it was cut."""
    commands = drive.log.commands
    asked_rad = np.abs(commands.requested_position_rad - commands.position_rad).max()
    finding.demand(asked_rad > 0.05, "the log does not hold what was asked")


def not_loaded(name: str, change: Callable[[bytes], bytes]) -> Row:
    """Make a row of a file that is not what was exported: it is refused, in words."""

    def attempt(rig: Rig) -> Finding:
        finding = Finding("refused to load")
        try:
            policy_from_bytes(change(rig.policy_file.read_bytes()), source="changed policy")
        except PolicyError as error:
            finding.demand("changed policy" in str(error), f"the error does not name the file: {error}")
        else:
            finding.problems.append("it was loaded")
        return finding

    return Row(f"policy file {name}", 0.0, attempt)


def with_byte_changed(data: bytes) -> bytes:
    """Change one weight's exponent in the middle of the file."""
    changed = bytearray(data)
    changed[len(data) // 2 | 3] ^= 0x7F
    return bytes(changed)


def replaced_file(rig: Rig) -> Finding:
    """Replace the file while it runs: what was loaded, runs."""
    copy, data = rig.folder / "replaced.onnx", rig.policy_file.read_bytes()
    copy.write_bytes(data)
    drive = rig.drive(lambda _: copy.write_bytes(b"noise" * 1000), policy=load_policy(copy))
    finding = judge(drive, "completed")
    finding.demand(not drive.summary.skipped_ticks, f"{drive.summary.skipped_ticks} ticks were missed")
    is_same = drive.log.header.policy_sha256 == hashlib.sha256(data).hexdigest()
    finding.demand(is_same, "the log names another digest than that of what ran")
    return finding


CUT: Final = (IS_CUT,)
ONE_MINUS_INFINITY: Final = gives(lambda actions: first_is(actions, -np.inf))

ROWS = (
    row("policy gives NaN", 45.0, all_are(np.nan), "policy_not_finite", way="damping"),
    row("policy gives infinity", 45.0, all_are(np.inf), "policy_not_finite", way="damping"),
    row("policy far beyond the stops", FIVE_TICKS_MS, all_are(40.0), *FLUNG, way="damping", checks=CUT),
    row("policy jumps from stop to stop", FIVE_TICKS_MS, jumps, *THROWN_ABOUT, way="damping", checks=CUT),
    row("policy raises an error", 45.0, gives(breaks), "internal_error", way="damping"),
    row("policy gives eleven numbers", 45.0, gives(lambda a: a[:, :11]), "internal_error", way="damping"),
    row("policy too slow", 500.0, takes_long, "ticks_skipped", "state_stale", "command_refused", way=SOFT),
    not_loaded("with one byte changed", with_byte_changed),
    not_loaded("with a joint named twice", lambda data: data.replace(b'"fl_hx"', b'"fr_hx"')),
    not_loaded("cut in half", lambda data: data[: len(data) // 2]),
    Row("policy file replaced while running", 0.0, replaced_file),
    row(
        "policy beyond the stops for two ticks",
        0.0,
        overshoots_twice,
        "completed",
        missed=0,
        checks=(IS_CUT, is_logged_as_asked),
        source=STANDING,
    ),
    row("policy gives 1e38", FIVE_TICKS_MS, all_are(1e38), *FLUNG, way="damping", checks=CUT),
    row("policy gives minus infinity for one joint", 45.0, ONE_MINUS_INFINITY, "policy_not_finite", way="damping"),
)
