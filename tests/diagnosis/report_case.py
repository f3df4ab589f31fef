"""A diagnosis as the report gets it, without having to make one: two seconds of simulation and a verdict by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from diagnosis.channels import Channel
from diagnosis.document import (
    CalibratedNumber,
    Calibration,
    Consequences,
    Difference,
    GapCell,
    GapChange,
    GapLeft,
    Number,
    QuantityChange,
    Shrink,
    Split,
    Stretch,
    UnknownEffect,
    Verdict,
)
from diagnosis.library import JointGroups
from diagnosis.verdict.diagnose import Diagnosis
from spot_log.read.run import Run
from spot_model.effects.friction import CoulombFriction
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import load_policy
from spot_model.robot import facts
from trainer.simulate.recorded_runs import UsualNoise, simulate_scripts

from .planted import POLICY, scripts

REGIMES = ("all", "motoring", "motoring, high speed", "braking", "low speed", "high speed", "stance", "swing")


def runs(model: RobotModel, seed: int) -> list[Run]:
    """Simulated runs of the scripts."""
    return simulate_scripts(model, load_policy(POLICY), scripts(), np.random.default_rng(seed), UsualNoise())


def cells(rng: np.random.Generator, joints: tuple[str, ...]) -> tuple[GapCell, ...]:
    """Gap cells, some of them significant."""
    found = []
    for signal, unit in (("load error", "N·m"), ("load", "N·m"), ("velocity", "rad/s"), ("position", "rad")):
        for joint in joints:
            for regime in REGIMES:
                ratio = float(1.0 + rng.exponential(6.0 if joint == "fl_kn" and unit == "N·m" else 0.4))
                found.append(
                    GapCell(
                        signal=signal,
                        joint=joint,
                        regime=regime,
                        gap=0.1 * ratio,
                        floor=0.1,
                        ratio=ratio,
                        p_value=0.01 if ratio > 3.0 else 0.4,
                        unit=unit,
                        n_samples=1200,
                    )
                )
    return tuple(sorted(found, key=lambda c: -(c.ratio or 0.0)))


def consequences(**changes: Any) -> Consequences:
    """A torque gap that closes, one that is not shown to, one that grows; slower, and falls more often."""
    data: dict[str, Any] = {
        "loop": "closed",
        "gaps": (
            GapChange(gap="torque", unit="N·m", before=4.2, after=1.0, floor=0.4, share=0.84, low=0.77, high=0.9),
            GapChange(
                gap="joint motion", unit="rad/s", before=0.31, after=0.29, floor=0.2, share=0.18, low=-0.1, high=0.4
            ),
            GapChange(
                gap="body motion", unit="m/s", before=0.04, after=0.06, floor=0.03, share=-2.0, low=-3.0, high=-0.8
            ),
        ),
        "changes": (
            change("top_speed", "top speed, held for 1 s", "m/s", 1.52, 1.31, low=-0.25, high=-0.18, robot=1.3),
            change("power", "mechanical power, mean of what the joints give", "W", 210.0, 214.0, low=-9.0, high=17.0),
            change("lean", "largest lean of the body", "rad", 0.12, 0.15, low=0.01, high=0.05, robot=0.16),
            change("fall_share", "share of runs that fall", "", 0.0, 0.0, robot=0.0),
            change("time_to_fall", "mean time to a fall, within the commands", "s", None, 6.0),
        ),
    }
    return Consequences(**(data | changes))


def change(name: str, title: str, unit: str, before: float | None, after: float | None, **more: Any) -> QuantityChange:
    """One quantity."""
    return QuantityChange(quantity=name, title=title, unit=unit, before=before, after=after, **more)


def calibration() -> Calibration:
    """Torque gains by joint type, two of which stand out, and a friction that does not."""
    gains = {"kn": 0.86, "hy": 0.95, "hx": 0.98}
    numbers = [
        CalibratedNumber(
            effect="torque_gain",
            parameter="gain",
            title="torque gain",
            where=where,
            nominal=1.0,
            value=gain,
            low=gain - 0.01,
            high=gain + 0.01,
            spread=0.015,
            probability=0.99 if gain < 0.96 else 0.02,
            stands_out=gain < 0.96,
        )
        for where, gain in gains.items()
    ]
    friction = CalibratedNumber(
        effect="coulomb_friction",
        parameter="level_nm",
        title="dry friction",
        where="hy",
        nominal=0.0,
        value=0.12,
        low=-0.05,
        high=0.3,
        unit="N·m",
        spread=0.15,
    )
    gap = GapChange(gap="torque", unit="N·m", before=2.6, after=1.0, floor=0.4, share=0.73, low=0.6, high=0.8)
    kinds = {"torque_gain": consequences(gaps=(gap,))}
    return Calibration(numbers=(*numbers, friction), consequences=consequences(changes=()), effects=kinds)


def verdict(where: tuple[GapCell, ...], **changes: Any) -> Verdict:
    """A verdict with everything in it: long names, a group, numbers by joint type, an unknown part."""
    difference = Difference(
        name="coulomb_friction",
        title="dry friction",
        probability=0.71,
        group=("coulomb_friction", "stribeck_friction"),
        joints=("fl_kn",),
        split_by="Walk slowly: what acts near standstill grows.",
        split=Split(
            name="slow",
            text="Walk slowly: what acts near standstill grows.",
            command="spot-rl collect --robot HOST --out MORE",
            sequence_file="experiments/slow_walk.yaml",
        ),
        parameters={"level_nm": Number(value=2.02, low=1.91, high=2.13, unit="N·m")},
        by_type={"kn": {"level_nm": Number(value=2.4, low=2.2, high=2.6, unit="N·m")}},
        rivals={"coulomb_friction": 0.51, "stribeck_friction": 0.2, "load_friction": 0.001},
        gain_nats=512.0,
        channels={Channel.SET_POINT_TO_LOAD: 498.0, Channel.LOAD_TO_MOTION: 14.0},
        consequences=consequences(),
    )
    data: dict[str, Any] = {
        "status": "partly_explained",
        "where": where[:60],
        "differences": (difference,),
        "calibration": calibration(),
        "consequences": consequences(),
        "remainder": (
            GapLeft(gap="torque", unit="N·m", left=1.0, floor=0.4, ratio=2.5),
            GapLeft(gap="joint motion", unit="rad/s", left=0.21, floor=0.2, ratio=1.05),
            GapLeft(gap="body motion", unit="m/s", left=0.04, floor=0.0, ratio=None),
        ),
        "probability_none": 0.001,
        "probability_unknown": 0.35,
        "unknown": UnknownEffect(
            joints=("fl_kn",),
            regime="motoring",
            channel=Channel.SET_POINT_TO_LOAD,
            unit="N·m",
            left=1.6,
            usual=0.8,
        ),
        "channels": {
            Channel.SET_POINT_TO_LOAD: "used",
            Channel.LOAD_TO_MOTION: "used",
            Channel.BATTERY_POWER: "off: no battery record",
            Channel.TIME_STAMPS: "off: no receipts of commands",
        },
        "invisible": ("power_limit", "bus_sag", "command_delay"),
        "shrink": Shrink(d0=4.1, d1=1.5, floor=1.0, s=0.84, s_low=0.77, s_high=0.9, held_out=("a", "b")),
        "log_advice": ("Record each command sequence five times.", "Record a sprint."),
        "timeline": (
            Stretch(log="simulated-a-1", kind="start", start_s=0.0, end_s=0.2, reason="settling"),
            Stretch(log="simulated-a-1", kind="gap", start_s=1.0, end_s=2.0, reason="the load's error is large"),
        ),
        "logs": ("a.mcap", "b.mcap"),
        "nominal": "nominal.yaml",
        "held": ("the play of fl_kn is fitted as −0.01 rad, and held at 0",),
        "notes": ("A note with <markup> & more.",),
    }
    return Verdict(**(data | changes))


def a_diagnosis(joints: tuple[str, ...] = facts.JOINT_NAMES, **changes: Any) -> Diagnosis:
    """All of it."""
    found = cells(np.random.default_rng(0), joints)
    real = runs(RobotModel((CoulombFriction(joints=("fl_kn",), level_nm=2.0),)), 1)
    nominal, corrected = tuple(runs(RobotModel(), 2)), tuple(runs(RobotModel(), 3))
    told = verdict(found, **changes)
    robot = JointGroups(joints, np.repeat(np.arange(4), 3)[: len(joints)])
    return Diagnosis(
        told,
        RobotModel(),
        found,
        {"nominal": nominal, "corrected": corrected},
        tuple(real),
        SimpleNamespace(robot=robot),
        None,  # type: ignore[arg-type]
    )
