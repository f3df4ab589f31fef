"""Experiments that could be next, as typed values: what is run, which of its numbers may be chosen, what it needs."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from spot_model.io.joint_experiment import JointExperiment, Squat, Standing, Sweep
from spot_model.io.velocity_sequence import VelocitySequence, sequence_of
from spot_model.policy.contract import PolicyContract
from spot_model.robot import facts

Motion = VelocitySequence | JointExperiment
HANDOVER_S: Final = 12.0
"""Robot time that a run takes beside its motion: to stand up, ramps in and out, soft stop, to sit down. A squat of 10 s
took 22 s on the fake robot."""
SWEPT: Final = 3
"""Joints that are swept one by one, at most."""


@dataclass(frozen=True)
class Free:
    """A number of an experiment that may be chosen."""

    start: float
    low: float
    high: float
    unit: str


HEAT: Final = "thermal_derating"
"""The effect that a warm-up shows; without it, a minute of squats is not worth its time."""
GAINS: Final[Mapping[str, Free]] = {
    "kp_nm_per_rad": Free(250.0, 200.0, 300.0, "N·m/rad"),
    "kd_nm_s_per_rad": Free(5.0, 3.0, 6.0, "N·m·s/rad"),
}
"""Other gains than the policy's tell drag from damping, and stiffness from a drive's gain."""


@dataclass(frozen=True)
class Candidate:
    """A kind of experiment with free numbers."""

    name: str
    title: str
    needs: str
    """What must be there beside the robot."""
    free: Mapping[str, Free]
    build: Callable[[Mapping[str, float]], Motion]
    values: Mapping[str, float] = field(default_factory=dict)
    """Chosen so far; the starts of the rest."""
    is_own: bool = False
    """A user's own, which is run whatever it tells, if it is safe."""

    @property
    def chosen(self) -> dict[str, float]:
        """All numbers."""
        return {name: self.values.get(name, free.start) for name, free in self.free.items()}

    def motion(self) -> Motion:
        """The experiment with these numbers."""
        return self.build(self.chosen)

    @property
    def robot_s(self) -> float:
        """Robot time, s."""
        return self.motion().duration_s + HANDOVER_S


STANDING: Final = Candidate(
    "standing",
    "stand, and shift the weight slowly over the feet",
    "level ground",
    {
        "shift_m": Free(0.04, 0.02, 0.06, "m"),
        "frequency_hz": Free(0.4, 0.15, 0.8, "Hz"),
        "duration_s": Free(8.0, 6.0, 16.0, "s"),
    },
    lambda v: Standing(
        name="standing",
        duration_s=v["duration_s"],
        shift_x_m=v["shift_m"],
        shift_y_m=v["shift_m"],
        frequency_hz=v["frequency_hz"],
    ),
)
SQUAT: Final = Candidate(
    "squat",
    "stand, and go down and up",
    "level ground",
    {
        "depth_m": Free(0.10, 0.04, 0.14, "m"),
        "frequency_hz": Free(0.6, 0.2, 1.2, "Hz"),
        **GAINS,
        "duration_s": Free(8.0, 6.0, 16.0, "s"),
    },
    lambda v: Squat.model_validate({"name": "squat", **v}),
)
WARM_UP: Final = Candidate(
    "warm_up",
    "go down and up until the motors are warm",
    "level ground; the motors get hot: keep hands off them afterwards",
    {
        "depth_m": Free(0.12, 0.06, 0.14, "m"),
        "frequency_hz": Free(0.8, 0.4, 1.0, "Hz"),
        "duration_s": Free(40.0, 30.0, 50.0, "s"),
    },
    lambda v: Squat.model_validate({"name": "warm_up", **v}),
)


def candidates(
    policy: PolicyContract | None, suspects: Sequence[str], effects: Collection[str] = ()
) -> tuple[Candidate, ...]:
    """All that could be next: walks where there is a policy, sweeps of the likeliest ``suspects`` among the joints.

    ``effects`` are those that may be the cause.
    """
    walks = _walks(policy) if policy is not None else ()
    sweeps = [_sweep(joint) for joint in suspects[:SWEPT] if joint in facts.JOINT_NAMES]
    return (*walks, STANDING, SQUAT, *([WARM_UP] if HEAT in effects else []), *sweeps)


def given(motion: Motion) -> Candidate:
    """A user's own experiment; nothing of it may be chosen. Its name becomes one that a file can have."""
    name = re.sub(r"[^\w-]+", "_", motion.name)
    return Candidate(name, f"{motion.name}, from a file", "what the file asks for", {}, lambda _: motion, is_own=True)


def _walks(policy: PolicyContract) -> tuple[Candidate, ...]:
    top, aside, turn = policy.velocity_command_high
    brisk = min(top, 1.6)
    needs = "the policy, and room to walk"
    return (
        Candidate(
            "sprint",
            "run ahead with rising speed, then stop",
            f"the policy, and {0.4 * top * 12.0 + 2.0:.0f} m straight ahead",
            {
                "speed_m_s": Free(0.6 * top, 0.3 * top, 0.8 * top, "m/s"),
                "duration_s": Free(8.0, 6.0, 12.0, "s"),
            },
            lambda v: _ramped(
                "sprint",
                v["duration_s"],
                (0.5, 0.1),
                (0.7 * v["duration_s"], v["speed_m_s"]),
                (0.85 * v["duration_s"], v["speed_m_s"]),
            ),
        ),
        Candidate(
            "to_and_fro",
            "walk ahead and back by turns",
            needs,
            {
                "speed_m_s": Free(0.3 * brisk, min(0.2, 0.2 * brisk), 0.5 * brisk, "m/s"),
                "period_s": Free(3.0, 2.0, 4.0, "s"),
            },
            lambda v: _to_and_fro(v["speed_m_s"], v["period_s"]),
        ),
        Candidate(
            "turns",
            "turn in place, then step sideways, both ways",
            needs,
            {
                "turn_rad_s": Free(0.6 * turn, 0.3 * turn, turn, "rad/s"),
                "aside_m_s": Free(0.6 * aside, 0.2 * aside, aside, "m/s"),
            },
            lambda v: sequence_of(
                "turns",
                8.0,
                (0.0,),
                (0.5, 0.0, 0.0, v["turn_rad_s"]),
                (2.3, 0.0, 0.0, -v["turn_rad_s"]),
                (4.1, 0.0, v["aside_m_s"]),
                (5.8, 0.0, -v["aside_m_s"]),
                (7.5,),
            ),
        ),
        Candidate(
            "slow_walk",
            "walk slowly",
            needs,
            {"speed_m_s": Free(0.25, 0.1, 0.5, "m/s")},
            lambda v: _ramped("slow_walk", 8.0, (1.0, v["speed_m_s"]), (6.5, v["speed_m_s"])),
        ),
    )


def _ramped(name: str, duration_s: float, *points: tuple[float, float]) -> VelocitySequence:
    """Straight lines between forward speeds, each a time and m/s, from rest to rest."""
    return sequence_of(name, duration_s, (0.0,), *points, (duration_s - 0.5,), is_ramped=True)


def _to_and_fro(speed_m_s: float, period_s: float) -> VelocitySequence:
    """Each way for a quarter of the period; the turn-round takes as long."""
    duration_s, quarter_s = 8.0, 0.25 * period_s
    points = [(0.5, 0.0)]
    for i, t in enumerate(np.arange(0.5 + quarter_s, duration_s - 1.0 - quarter_s, 2.0 * quarter_s)):
        speed = speed_m_s * (-1.0) ** i
        points += [(float(t), speed), (float(t + quarter_s), speed)]
    return _ramped("to_and_fro", duration_s, *points)


def _sweep(joint: str) -> Candidate:
    return Candidate(
        f"sweep_{joint}",
        f"stand on three legs, and swing {joint} faster and faster",
        "level ground, and a person who keeps clear of the leg",
        {
            "amplitude_rad": Free(0.2, 0.05, 0.3, "rad"),
            "end_hz": Free(2.5, 1.0, 3.0, "Hz"),
            **GAINS,
            "duration_s": Free(10.0, 9.0, 16.0, "s"),
        },
        lambda v: Sweep.model_validate({"name": f"sweep_{joint}", "joint": joint, **v}),
    )
