"""The menu: recordings that could be next, each with what it needs."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

from spot_model.io.joint_experiment import JointExperiment, Squat, Standing, Sweep
from spot_model.io.velocity_sequence import VelocitySequence, sequence_of
from spot_model.policy.contract import PolicyContract

Motion = VelocitySequence | JointExperiment
HANDOVER_S: Final = 12.0
"""Robot time that a run takes beside its motion: to stand up, ramps in and out, soft stop, to sit down. A squat of 10 s
took 22 s on the fake robot."""
SWEPT: Final = 3
"""Joints that are swept one by one, at most."""
HEAT: Final = "thermal_derating"
"""The effect that a warm-up shows; without it, a minute of squats is not worth its time."""


@dataclass(frozen=True)
class Candidate:
    """A recording of the menu."""

    title: str
    needs: str
    """What must be there beside the robot."""
    motion: Motion
    is_own: bool = False
    """A user's own, which is offered whatever it tells, if it is safe."""

    @property
    def name(self) -> str:
        """Its name, as a file can have it."""
        return re.sub(r"[^\w-]+", "_", self.motion.name)

    @property
    def robot_s(self) -> float:
        """Robot time, s."""
        return self.motion.duration_s + HANDOVER_S


LEVEL: Final = "level ground"
SHIFTS: Final = Standing(name="standing", duration_s=8.0, frequency_hz=0.4)
SQUAT: Final = Squat(name="squat", duration_s=8.0, frequency_hz=0.6)
WARM_UP: Final = Squat(name="warm_up", duration_s=40.0, depth_m=0.12, frequency_hz=0.8)


def candidates(
    policy: PolicyContract | None, joints: Sequence[str], effects: Collection[str] = ()
) -> tuple[Candidate, ...]:
    """The menu: walks where there is a policy, and sweeps of the first of the ``joints`` in doubt.

    ``effects`` are those that may be there.
    """
    menu = [] if policy is None else _walks(policy)
    menu.append(Candidate("stand, and shift the weight slowly over the feet", LEVEL, SHIFTS))
    menu.append(Candidate("stand, and go down and up", LEVEL, SQUAT))
    if HEAT in effects:
        hot = f"{LEVEL}; the motors get hot: keep hands off them afterwards"
        menu.append(Candidate("go down and up until the motors are warm", hot, WARM_UP))
    for joint in joints[:SWEPT]:
        title = f"stand on three legs, and swing {joint} faster and faster"
        sweep = Sweep(name=f"sweep_{joint}", joint=joint, duration_s=10.0, end_hz=2.5)
        menu.append(Candidate(title, f"{LEVEL}, and a person who keeps clear of the leg", sweep))
    return tuple(menu)


def given(motion: Motion) -> Candidate:
    """A user's own recording."""
    return Candidate(f"{motion.name}, from a file", "what the file asks for", motion, is_own=True)


def _walks(policy: PolicyContract) -> list[Candidate]:
    top, aside, turn = (0.6 * most for most in policy.velocity_command_high)
    half = 0.5 * min(top, 0.96)
    to_and_fro = [(1.25 + 0.75 * i, half * (-1.0) ** (i // 2)) for i in range(8)]
    rising, slow = [(0.5, 0.1), (5.6, top), (6.8, top)], [(1.0, 0.25), (6.5, 0.25)]
    turns = [(0.5, 0.0, 0.0, turn), (2.3, 0.0, 0.0, -turn), (4.1, 0.0, aside), (5.8, 0.0, -aside)]
    room = "the policy, and room to walk"
    return [
        Candidate(
            "run ahead with rising speed, then stop",
            f"the policy, and {4.1 * top + 2.0:.0f} m straight ahead",
            _walk("sprint", rising),
        ),
        Candidate("walk ahead and back by turns", room, _walk("to_and_fro", [(0.5, 0.0), *to_and_fro])),
        Candidate("turn in place, then step sideways, both ways", room, _walk("turns", turns, is_ramped=False)),
        Candidate("walk slowly", room, _walk("slow_walk", slow)),
    ]


def _walk(name: str, points: Sequence[Sequence[float]], *, is_ramped: bool = True) -> VelocitySequence:
    """Eight seconds from rest to rest, by times and velocities, in straight lines or in steps."""
    return sequence_of(name, 8.0, (0.0,), *points, (7.5,), is_ramped=is_ramped)
