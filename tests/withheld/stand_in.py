"""A small reality for the tests of the withheld check: the planted logs of the diagnosis' tests, as files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from spot_log.format.codec import header_to_proto
from spot_log.read.run import Run
from spot_log.write.run_writer import RunWriter
from spot_model.effects.base import Effect
from spot_model.effects.body.payload_mass import PayloadMass
from spot_model.effects.command.command_delay import CommandDelay
from spot_model.effects.drive.armature import Armature
from spot_model.effects.drive.coulomb_friction import CoulombFriction
from spot_model.effects.drive.torque_gain import TorqueGain
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import load_policy
from spot_model.robot.facts import JOINT_NAMES
from spot_model.robot.joints import select_joints
from spot_protos import log_pb2
from tests.diagnosis.planted import Truth as Planted
from tests.diagnosis.planted import planted_runs
from withheld.plan import Family, Fault, FaultRequest, Place, RecordingPlan, Truth
from withheld.simulator.simulation import RealityDivergedError

NOMINAL = RobotModel((CommandDelay(delay_s=0.005), Armature(joints=("knees",), inertia_kg_m2=0.03)))
"""Mean delay of the planted transport; an inertia that logs and model share."""


@dataclass(frozen=True)
class StandInKind:
    """What a draw must know."""

    family: Family
    names: tuple[str, ...]
    places: tuple[Place, ...]


KINDS: dict[str, StandInKind] = {
    "gain": StandInKind("drive", ("torque_gain",), ("type", "all")),
    "friction": StandInKind("friction", ("coulomb_friction",), ("joint", "type")),
    "payload": StandInKind("body", ("payload_mass",), ("body",)),
    "odd": StandInKind("friction", (), ("joint",)),
}


class Alone:
    """Planted logs; what is hidden follows from the seed, or from requests."""

    def __init__(self, seed: int, requests: Sequence[FaultRequest] | None = None) -> None:
        rng = np.random.default_rng([seed, 1])
        if requests is None:
            kinds = ("none", "gain", "friction")
            kind = kinds[int(rng.integers(len(kinds)))]
            requests = () if kind == "none" else (FaultRequest(kind=kind, place="type", size=0.8),)
        self._effects, faults = [], []
        for request in requests:
            effect, fault = _made(request, rng)
            self._effects.append(effect)
            faults.append(fault)
        self._truth = Truth(faults=tuple(faults))

    @property
    def truth(self) -> Truth:
        return self._truth

    @property
    def nominal(self) -> RobotModel:
        return NOMINAL

    def record(self, plan: RecordingPlan, folder: Path) -> None:
        rng = np.random.default_rng([plan.seed, 2])
        policy = load_policy(plan.policy)
        planted = Planted(effects=(*(e for e in NOMINAL.effects if e.name != "command_delay"), *self._effects))
        for sequence in plan.sequences:
            seed = int(rng.integers(2**31))
            for run in planted_runs(planted, plan.repeats, sequence=sequence, actor=lambda: policy, seed=seed):
                header = replace(run.header, run_id=rng.bytes(8).hex(), policy_name=policy.contract.name,
                                 policy_sha256=policy.sha256)
                write(replace(run, header=header), folder / f"{rng.bytes(8).hex()}.mcap")


class StandIn(Alone):
    """The same with kinds that a draw may ask for."""

    KINDS = KINDS


def _made(request: FaultRequest, rng: np.random.Generator) -> tuple[Effect, Fault]:
    if request.kind == "payload":
        mass = 12.0 * request.size
        return PayloadMass(mass_kg=mass), Fault(
            names=("payload_mass",), joints=(), parameters={"payload_mass.mass_kg": mass}, family="body",
            size=request.size, kind=request.kind,
        )
    where = {"type": ("kn",), "joint": ("fl_kn",), "leg": ("hl",), "all": ("all",)}[request.place]
    joints = tuple(n for n, there in zip(JOINT_NAMES, select_joints(where), strict=True) if there)
    if request.kind == "gain":
        gain = 1.0 - 0.3 * request.size
        return TorqueGain(joints=where, gain=gain), Fault(
            names=("torque_gain",), joints=joints, parameters={"torque_gain.gain": gain}, family="drive",
            size=request.size, kind=request.kind,
        )
    level = 4.0 * request.size
    if request.kind == "odd":
        return CoulombFriction(joints=where, level_nm=level), Fault(
            names=(), joints=joints, family="friction", size=request.size, kind=request.kind
        )
    return CoulombFriction(joints=where, level_nm=level), Fault(
        names=("coulomb_friction",), joints=joints, parameters={"coulomb_friction.level_nm": level}, family="friction",
        size=request.size, kind=request.kind,
    )


def write(run: Run, path: Path) -> None:
    """Write a log that is in memory."""
    writer = RunWriter(path, header_to_proto(run.header))
    s, c, t, b = run.states, run.commands, run.ticks, run.slow_states
    records: list[tuple[int, Any]] = []
    per = len(s.imu.robot_stamp_ns) // max(1, len(s))
    skip = {"imu", "sequence"}
    for i in range(len(s)):
        imu = [
            log_pb2.ImuPacket(
                robot_stamp_ns=int(s.imu.robot_stamp_ns[k]),
                acceleration_of_imu_in_link_m_s2=s.imu.acceleration_of_imu_in_link_m_s2[k].tolist(),
                angular_vel_of_link_in_link_rad_s=s.imu.angular_vel_of_link_in_link_rad_s[k].tolist(),
                odom_from_link_wxyz=s.imu.odom_from_link_wxyz[k].tolist(),
            )
            for k in range(per * i, per * (i + 1))
        ]
        records.append((int(s.host_stamp_ns[i]), log_pb2.State(imu=imu, **_row(s, i, skip))))
    records += [(int(c.host_stamp_ns[i]), log_pb2.Command(**_row(c, i, set()))) for i in range(len(c))]
    records += [(int(t.host_stamp_ns[i]), log_pb2.Tick(**(_row(t, i, {"mode"}) | {"mode": "active"})))
                for i in range(len(t))]
    for i in range(len(b)):
        row = {k: getattr(b, k)[i].item() for k in ("robot_stamp_ns", "host_stamp_ns", "motors_powered", "estopped",
               "battery_charge_percent", "battery_voltage_v", "battery_current_a")}
        records.append((row["host_stamp_ns"], log_pb2.SlowState(**row)))
    numbers: dict[type, int] = {}
    for _, message in sorted(records, key=lambda r: r[0]):
        number = numbers.get(type(message), 0)
        numbers[type(message)] = number + 1
        writer.add(message, number)
        if writer.is_chunk_full:
            writer.flush()
    writer.close({}, "completed")


def _row(table: Any, i: int, skip: set[str]) -> dict[str, Any]:
    return {name: getattr(table, name)[i].tolist() for name in table.__dataclass_fields__ if name not in skip}


class Brittle(StandIn):
    """The first robot of every case breaks its simulation."""

    broken: ClassVar[set[Path]] = set()

    def record(self, plan: RecordingPlan, folder: Path) -> None:
        if folder.name == "logs" and folder not in self.broken:
            self.broken.add(folder)
            raise RealityDivergedError("not a number")
        super().record(plan, folder)
