"""How well the diagnosis does on logs of the fake robot with one hidden effect at a time.

The fake robot runs in a process of its own, with other physics than the nominal simulator; the diagnosis sees its
logs alone. Steps: ``logs`` records every case, ``diagnose`` explains each in a process of its own, ``score`` prints
top-1, joints, false alarms.

    python lab/benchmarks/diagnose_fake.py logs --work DIR --policy baseline
    python lab/benchmarks/diagnose_fake.py diagnose --work DIR
    python lab/benchmarks/diagnose_fake.py score --work DIR
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from fake_robot.scenario.scenario import DEFAULT_EFFECTS
from fake_robot.start.process import FakeAddress, FakeProcess
from spot_model.io.velocity_sequence import VelocitySequence, save_sequence, sequence_of
from spot_model.policy.built_in import policy_file
from spot_model.robot.facts import JOINT_NAMES
from spot_model.robot.joints import select_joints

NOMINAL_ONLY: Final[list[dict[str, Any]]] = [
    {"effect": "armature", "joints": ["hips"], "inertia_kg_m2": 0.0403},
    {"effect": "armature", "joints": ["knees"], "inertia_kg_m2": 0.0731},
    {"effect": "command_delay", "joints": ["all"], "delay_s": 0.006},
]
"""What the fake robot has outside of its effects: rotor inertias and the channels' delays."""


@dataclass(frozen=True)
class Case:
    """One reality."""

    name: str
    effects: tuple[dict[str, Any], ...] = ()
    changes: dict[str, Any] = field(default_factory=dict)
    """Other top-level keys of the scenario."""


def one(effect: str, joints: list[str], name: str = "", **values: float) -> Case:
    """A reality with one more effect."""
    return Case(name or effect, ({"effect": effect, "joints": joints, **values},))


CASES: Final[tuple[Case, ...]] = (
    Case("none"),
    one("coulomb_friction", ["fl_kn"], level_nm=2.5),
    one("viscous_friction", ["hy"], damping_nm_s_per_rad=0.5),
    one("torque_gain", ["hr"], gain=0.85),
    one("torque_limit", ["knees"], limit_nm=35.0),
    one("armature", ["knees"], inertia_kg_m2=0.05),
    one("command_delay", ["all"], delay_s=0.010),
    one("torque_bandwidth", ["all"], time_constant_s=0.012),
    one("payload_mass", ["all"], mass_kg=6.0),
    one("encoder_offset", ["hl_kn"], offset_rad=0.05),
    one("velocity_estimate", ["all"], scale=0.85, bias_x_m_s=0.08, lag_s=0.03),
    one("power_limit", ["all"], power_w=900.0, copper_w_per_nm2=0.03),
    Case("none_again", changes={"seed": 77}),
    one("load_friction", ["all"], share=0.15),
    one("stribeck_friction", ["hy"], level_nm=3.0, speed_rad_s=0.5),
    one("backlash", ["fr_kn"], gap_rad=0.02),
    one("thermal_derating", ["all"], loss_per_k=0.02, heating_k_per_nm2_s=0.01),
    one("torque_ripple", ["fl_hy"], amplitude_nm=2.5, cycles_per_rad=12.0),
    one("leg_mass", ["hl"], scale=1.5),
    one("com_offset", ["all"], x_m=0.05),
    one("ground_friction", ["all"], scale=0.5),
    one("bus_sag", ["all"], resistance_ohm=0.4, back_emf_v_s_per_rad=3.0, stall_nm_per_v=2.5),
    one("velocity_filter", ["all"], time_constant_s=0.012),
    one("load_sensor_gain", ["fr_hy"], gain=0.85),
    one("joint_compliance", ["knees"], compliance_rad_per_nm=0.002),
    one("imu_tilt", ["all"], pitch_rad=0.05),
    Case(
        "two_friction_gain",
        (
            {"effect": "coulomb_friction", "joints": ["knees"], "level_nm": 2.0},
            {"effect": "torque_gain", "joints": ["fl_hy", "fr_hy", "hl_hy", "hr_hy"], "gain": 0.88},
        ),
    ),
    Case(
        "two_delay_viscous",
        (
            {"effect": "command_delay", "joints": ["all"], "delay_s": 0.008},
            {"effect": "viscous_friction", "joints": ["knees"], "damping_nm_s_per_rad": 0.4},
        ),
    ),
)


def sequences() -> tuple[VelocitySequence, ...]:
    """Three sequences of eight seconds that every committed policy can follow."""
    return (
        sequence_of(
            "ahead",
            8.0,
            (0, 0, 0, 0, False),
            (0.5, 0, 0, 0, False),
            (4, 2.0, 0, 0, True),
            (6.5, 2.0, 0, 0, True),
            (7.5, 0, 0, 0, True),
        ),
        sequence_of(
            "around",
            8.0,
            (0, 0, 0, 0, False),
            (0.5, 0.8, 0, 0, False),
            (2, -0.8, 0, 0, False),
            (3.5, 0, 0.6, 0, False),
            (5, 0, -0.6, 0, False),
            (6, 0, 0, 1.0, False),
            (7.2, 0, 0, 0, False),
        ),
        sequence_of(
            "mixed",
            8.0,
            (0, 0, 0, 0, False),
            (0.5, 1.4, 0.3, 0.4, False),
            (2.3, 0.3, -0.4, -0.8, False),
            (4, 1.8, 0, 0.6, False),
            (5.8, -0.5, 0.3, 0.2, False),
            (7.2, 0, 0, 0, False),
        ),
    )


def record(case: Case, folder: Path, policy: Path, repeats: int) -> None:
    """Make a case's logs."""
    model = {"effects": [*DEFAULT_EFFECTS, *case.effects]}
    collect({"schema": "spot-rl/scenario/1", "model": model, **case.changes}, folder, policy, repeats)


def collect(scenario: str | dict[str, Any], folder: Path, policy: Path, repeats: int) -> None:
    """Make logs of the three sequences on a fake robot."""
    folder.mkdir(parents=True, exist_ok=True)
    names = []
    for sequence in sequences():
        path = folder / f"{sequence.name}.yaml"
        if not path.exists():
            save_sequence(sequence, path)
        names.append(str(path))
    with FakeProcess(scenario=scenario, is_lock_step=True) as fake:
        words = ["collect", "--robot", fake.address.robot, "--policy", str(policy), "--out", str(folder / "logs")]
        words += ["--sequences", ",".join(names), "--repeats", str(repeats), "--lock-step", fake.address.admin]
        command = [sys.executable, "-m", "spot_model", *words]
        subprocess.run(command, env=_environment(fake.address), check=False)  # noqa: S603 - our own command


def _environment(address: FakeAddress) -> dict[str, str]:
    return {**os.environ, **address.environment, "OMP_NUM_THREADS": "1"}


def diagnose(folder: Path, nominal: Path, policy: Path, more: list[str]) -> float:
    """Explain a case; returns the wall time, s."""
    began = time.monotonic()
    words = ["diagnose", str(folder / "logs"), "--nominal", str(nominal), "--policy", str(policy)]
    words += ["--out", str(folder / "diagnosis"), *more]
    command = [sys.executable, "-m", "spot_model", *words]
    subprocess.run(command, check=False, env={**os.environ, "OMP_NUM_THREADS": "1"})  # noqa: S603 - our own command
    return time.monotonic() - began


def nominal_file(work: Path) -> Path:
    """The nominal model as a file."""
    path = work / "nominal.yaml"
    path.write_text(
        yaml.safe_dump({"schema": "spot-rl/model/1", "robot": "spot", "effects": [*DEFAULT_EFFECTS, *NOMINAL_ONLY]})
    )
    return path


def joints_of(case: Case) -> set[str]:
    """Joints that carry a hidden effect."""
    mask = np.zeros(len(JOINT_NAMES), dtype=bool)
    for effect in case.effects:
        mask |= select_joints(tuple(effect["joints"]))
    return {name for name, there in zip(JOINT_NAMES, mask, strict=True) if there}


def score(work: Path) -> None:
    """Print a line a case, and the totals."""
    top, grouped, effects, alarms, controls, f1s = 0, 0, 0, 0, 0, []
    for case in CASES:
        path = work / case.name / "diagnosis" / "verdict.json"
        if not path.exists():
            continue
        verdict = json.loads(path.read_text())
        found = verdict["differences"]
        listed = ", ".join(f"{e['name']} {e['probability']:.2f} {'/'.join(e['joints'])[:40]}" for e in found)
        s = verdict["shrink"]["s"] if verdict.get("shrink") else None
        print(
            f"{case.name:20s} {verdict['status']:17s} {listed or '-'}  none {verdict['probability_none']:.2f} "
            f"unknown {verdict['probability_unknown']:.2f} S {'-' if s is None else f'{s:.2f}'}"
        )
        truth = {e["effect"] for e in case.effects}
        if not truth:
            controls += 1
            alarms += verdict["status"] not in ("no_gap", "calibration", "cannot_tell")
            continue
        effects += 1
        names = [e["name"] for e in found]
        groups = [set(e["group"]) for e in found]
        top += set(names) == truth
        grouped += all(any(t in g and len(g) <= 3 for g in groups) for t in truth)
        said: set[str] = set().union(*(set(e["joints"]) for e in found)) if found else set()
        true = joints_of(case)
        hit = len(said & true)
        f1s.append(2 * hit / max(1, len(said) + len(true)))
    print(
        f"exact {top}/{effects}, in group {grouped}/{effects}, joint F1 {np.mean(f1s) if f1s else 0:.2f}, "
        f"false alarms {alarms}/{controls}"
    )


def main() -> None:
    """Run one step."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("step", choices=["logs", "diagnose", "score"])
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--policy", type=policy_file, default="baseline")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--cases", default="")
    parser.add_argument("more", nargs="*", help="more words for spot-rl diagnose, after --")
    given = parser.parse_args()
    chosen = [c for c in CASES if not given.cases or c.name in given.cases.split(",")]
    given.work.mkdir(parents=True, exist_ok=True)
    if given.step == "score":
        score(given.work)
        return
    nominal = nominal_file(given.work)
    for case in chosen:
        folder = given.work / case.name
        if given.step == "logs":
            record(case, folder, given.policy, given.repeats)
        elif (folder / "logs").is_dir():
            print(f"{case.name}: {diagnose(folder, nominal, given.policy, given.more):.0f} s", flush=True)


if __name__ == "__main__":
    main()
