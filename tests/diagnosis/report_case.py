"""A diagnosis as the report gets it, without having to make one: two seconds of simulation and a verdict by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from diagnosis.channels.channel import Channel
from diagnosis.closed_loop.gap_map import GapMap
from diagnosis.closed_loop.simulation import SensorNoise, simulate
from diagnosis.document import (
    Dependence,
    FoundEffect,
    GapCell,
    Number,
    OtherGap,
    Placebo,
    Shrink,
    Split,
    Stretch,
    UnknownEffect,
    Verdict,
)
from diagnosis.selection.places import Robot
from diagnosis.verdict.diagnose import Diagnosis
from spot_log.read.run import Run
from spot_model.effects.drive.coulomb_friction import CoulombFriction
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import load_policy
from spot_model.robot import facts

from .standing_starts import POLICY, scripts

REGIMES = ("all", "motoring", "motoring, high speed", "braking", "low speed", "high speed", "stance", "swing")


def runs(model: RobotModel, seed: int) -> list[Run]:
    """Simulated runs of the scripts."""
    return simulate(model, load_policy(POLICY), scripts(), np.random.default_rng(seed), SensorNoise())


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


def verdict(where: tuple[GapCell, ...], **changes: Any) -> Verdict:
    """A verdict with everything in it: long names, a group, an unknown part, a placebo."""
    effect = FoundEffect(
        name="coulomb_friction",
        title="dry friction",
        probability=0.71,
        group=("coulomb_friction", "stribeck_friction"),
        joints=("fl_kn",),
        split_by="Walk slowly: what acts near standstill grows.",
        split=Split(
            name="slow",
            text="Walk slowly.",
            command="spot-rl collect --robot HOST --out MORE",
            sequence_file="experiments/slow_walk.yaml",
        ),
        parameters={"level_nm": Number(value=2.02, low=1.91, high=2.13, unit="N·m")},
        rivals={"coulomb_friction": 0.71, "stribeck_friction": 0.2, "load_friction": 0.05, "torque_gain": 0.01},
        gain_nats=512.0,
        channels={Channel.SET_POINT_TO_LOAD: 498.0, Channel.LOAD_TO_MOTION: 14.0},
    )
    curve = Dependence(quantity="velocity", importance=0.6, at=(-4.0, -1.0, 1.0, 4.0), residual=(-1.0, -0.4, 0.5, 1.1))
    data: dict[str, Any] = {
        "status": "partly_explained",
        "where": where[:60],
        "effects": (effect,),
        "probability_none": 0.001,
        "probability_unknown": 0.35,
        "unknown": UnknownEffect(
            joints=("fl_kn",),
            regime="motoring",
            depends_on=("velocity", "torque"),
            channel=Channel.SET_POINT_TO_LOAD,
            unit="N·m",
            predictable_share=0.4,
            curves=(curve, curve.model_copy(update={"quantity": "torque"})),
        ),
        "channels": {
            Channel.SET_POINT_TO_LOAD: "used",
            Channel.LOAD_TO_MOTION: "used",
            Channel.BATTERY_POWER: "off: no battery record",
            Channel.TIME_STAMPS: "off: no receipts of commands",
        },
        "invisible": ("power_limit", "bus_sag", "command_delay"),
        "shrink": Shrink(
            d0=4.1,
            d1=1.5,
            floor=1.0,
            s=0.84,
            s_low=0.77,
            s_high=0.9,
            held_out=("a", "b"),
            placebo=Placebo(name="armature", s=0.21),
            beside=(OtherGap(name="load", unit="N·m", before=1.4, after=0.5, floor=0.3),),
        ),
        "log_advice": ("Record each command sequence five times.", "Record a sprint."),
        "timeline": (
            Stretch(log="simulated-a-1", kind="start", start_s=0.0, end_s=0.2, reason="settling"),
            Stretch(log="simulated-a-1", kind="gap", start_s=1.0, end_s=2.0, reason="the load's error is large"),
        ),
        "logs": ("a.mcap", "b.mcap"),
        "nominal": "nominal.yaml",
        "notes": ("A note with <markup> & more.",),
    }
    return Verdict(**(data | changes))


def a_diagnosis(joints: tuple[str, ...] = facts.JOINT_NAMES, **changes: Any) -> Diagnosis:
    """All of it."""
    found = cells(np.random.default_rng(0), joints)
    real = runs(RobotModel((CoulombFriction(joints=("fl_kn",), level_nm=2.0),)), 1)
    nominal, corrected = tuple(runs(RobotModel(), 2)), tuple(runs(RobotModel(), 3))
    told = verdict(found, **changes)
    robot = Robot(joints, np.repeat(np.arange(4), 3)[: len(joints)])
    return Diagnosis(
        told,
        RobotModel(),
        GapMap(found, has_floor=True, note=""),
        {"nominal": nominal, "corrected": corrected},
        tuple(real),
        SimpleNamespace(robot=robot),
        None,  # type: ignore[arg-type]
    )
