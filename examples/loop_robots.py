"""The five robots of the loop: two fake robots, and three of the withheld simulator with one actuator fault each.

``spot-rl run`` walks a fake robot over the network. The withheld simulator, which shares no formula of drives, battery
or estimator with the models that explain it, walks a policy itself; its logs end where the runtime would have stopped.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Final, Protocol

import numpy as np
import yaml

from fake_robot.scenario.scenario import load_scenario
from fake_robot.start.process import FakeProcess
from spot_model.effects.base import Effect
from spot_model.effects.commands import CommandDelay
from spot_model.effects.drivetrain import TorqueBandwidth
from spot_model.effects.friction import Armature, CoulombFriction
from spot_model.effects.torque_limits import TorqueLimit
from spot_model.io.model_file import RobotModel, load_model
from spot_model.io.velocity_sequence import VelocitySequence, save_sequence
from spot_model.policy.policy import load_policy
from spot_model.robot import facts
from spot_model.robot.rotation import tilt_rad
from spot_runtime.control.safety.body_height import is_body_above
from spot_runtime.safety_limits import SafetyLimits
from withheld.realities.calibrating import drive, limits
from withheld.realities.fault_kind import Ask, Flags
from withheld.realities.reality import EPOCH_NS, NOMINAL
from withheld.simulator.draws import add_ordinary_errors, add_surroundings, draw_settings, stream
from withheld.simulator.log import LogSetting, write_log
from withheld.simulator.recorder import RunArrays
from withheld.simulator.robot import Robot
from withheld.simulator.simulation import RunRequest, simulate

HERE: Final = Path(__file__).resolve().parent
LIMITS: Final = SafetyLimits()


class LoopRobot(Protocol):
    """A robot that walks policies and leaves logs."""

    def walk(self, policy: Path, sequence: VelocitySequence, seed: int, path: Path) -> None:
        """Write the log of one walk to ``path``; the seed draws noise, delays and what else differs from run to run."""

    def nominal(self) -> RobotModel:
        """The simulator's model as it was before any log."""

    def truth(self) -> RobotModel:
        """What a policy trained with full knowledge of the robot may know: the closest model of the effect library."""


@dataclass(frozen=True)
class FakeLoopRobot:
    """A fake robot, walked through the vendor's API."""

    scenario: Path

    def walk(self, policy: Path, sequence: VelocitySequence, seed: int, path: Path) -> None:
        """Run it in lock-step."""
        folder = path.with_suffix("")
        folder.mkdir(parents=True, exist_ok=True)
        scenario = load_scenario(self.scenario)
        own = scenario.with_changes(seed=scenario.seed + seed).to_data()
        for name in ("scenario.yaml", "sequence.yaml"):
            (folder / name).unlink(missing_ok=True)
        (folder / "scenario.yaml").write_text(yaml.safe_dump(own, sort_keys=False), encoding="utf-8")
        save_sequence(sequence, folder / "sequence.yaml")
        with (
            (folder / "run.log").open("ab") as said,
            FakeProcess(scenario=str(folder / "scenario.yaml"), is_lock_step=True) as fake,
        ):
            words = [sys.executable, "-m", "spot_model", "run", "--robot", fake.address.robot, "--policy", str(policy)]
            words += ["--sequence", str(folder / "sequence.yaml"), "--log-dir", str(folder)]
            words += ["--lock-step", fake.address.admin]
            environment = {**os.environ, **fake.address.environment}
            subprocess.run(words, env=environment, stdout=said, stderr=said, check=False)  # noqa: S603
        (log,) = folder.glob("*.mcap")
        log.rename(path)

    def nominal(self) -> RobotModel:
        """The paper's initial model, in which *before* was trained."""
        return load_model("paper_initial")

    def truth(self) -> RobotModel:
        """The scenario's effects, its inertia, and the mean delay that policies are trained with."""
        scenario = load_scenario(self.scenario)
        return scenario.robot_model.with_effects(
            Armature(joints=("hips",), inertia_kg_m2=scenario.physics.armature_hip_kg_m2),
            Armature(joints=("knees",), inertia_kg_m2=scenario.physics.armature_knee_kg_m2),
            CommandDelay(delay_s=facts.TRAINING_COMMAND_DELAY_S),
        )


@dataclass(frozen=True)
class WithheldLoopRobot:
    """A robot of the withheld simulator with one fault, and ordinary errors and surroundings of its own."""

    seed: int
    install: Callable[[Robot], None]
    known: tuple[Effect, ...]
    """The fault in the words of the effect library."""

    def walk(self, policy: Path, sequence: VelocitySequence, seed: int, path: Path) -> None:
        """Simulate it, up to where the runtime would have stopped."""
        loaded = load_policy(policy)
        asked = sequence.clipped(loaded.contract.velocity_command_low, loaded.contract.velocity_command_high)
        rng = stream(self.seed, "run", sequence.name, seed)
        (run,) = simulate(self.robot(), loaded, [RunRequest(asked, rng)], draw_settings(stream(self.seed, "settings")))
        end, outcome = stop_of(run)
        setting = LogSetting(
            run_id=rng.bytes(16).hex(),
            sequence=sequence.name,
            repeat=seed,
            started_host_ns=EPOCH_NS + int(rng.integers(0, 86_400_000_000_000)),
            skew_ns=int(rng.integers(-300_000_000_000, 300_000_000_000)),
            first_state_ns=int(rng.integers(500_000_000, 900_000_000)),
            outcome=outcome,
        )
        path.parent.mkdir(parents=True, exist_ok=True)
        write_log(cut(run, end), loaded, setting, frozenset(), rng, path)

    def robot(self) -> Robot:
        """A fresh one."""
        robot = Robot()
        add_surroundings(robot, stream(self.seed, "surroundings"))
        add_ordinary_errors(robot, stream(self.seed, "ordinary errors"), 1.0)
        self.install(robot)
        return robot

    def nominal(self) -> RobotModel:
        """The withheld simulator's own model."""
        return NOMINAL

    def truth(self) -> RobotModel:
        """The simulator's nominal model and the fault; ordinary errors are unknown to anybody."""
        return NOMINAL.with_effects(*self.known)


def stop_of(run: RunArrays) -> tuple[int, str]:
    """The number of states until the runtime would have stopped, and why; the whole run if it would not have."""
    tilted = tilt_rad(run.odom_from_body_wxyz) > LIMITS.tilt_rad
    low = ~np.array(
        [
            is_body_above(LIMITS.body_height_m, *state)
            for state in zip(run.position_rad, run.odom_from_body_wxyz, strict=True)
        ]
    )
    fast = (np.abs(run.velocity_rad_s) > LIMITS.joint_velocity_rad_s).any(axis=1)
    reasons = {"tilt": tilted, "body_low": low, "joint_velocity": fast}
    ends = [(int(np.argmax(flags)), why) for why, flags in reasons.items() if flags.any()]
    return min(ends, default=(len(tilted), "completed"))


def cut(run: RunArrays, n_states: int) -> RunArrays:
    """The first states of a run, and the ticks among them."""
    n_ticks = int(np.searchsorted(run.tick_state, n_states))
    per_tick = {"tick_state", "observation", "action", "velocity_command", "requested_rad", "is_active"}
    columns = {
        f.name: getattr(run, f.name)[: n_ticks if f.name in per_tick else n_states]
        for f in fields(run)
        if f.name != "deliveries"
    }
    way = run.deliveries
    kept = {f.name: getattr(way, f.name)[:n_states] for f in fields(way)}
    return replace(run, **columns, deliveries=replace(way, **kept))


KNEES: Final[Flags] = np.array([name.endswith("kn") for name in facts.JOINT_NAMES])
ALL: Final[Flags] = np.ones(facts.N_JOINTS, dtype=np.bool_)

KNEE_LIMIT_NM: Final = 45.0
MORE_INERTIA: Final = 0.5
FRICTION_NM: Final = 1.0
LAG_S: Final = 0.010


def weak_knees(robot: Robot) -> None:
    """Knee drives whose current limit, with a soft bend, lies at :data:`KNEE_LIMIT_NM`; 97 and 109 N·m are usual."""
    size = (limits.LARGEST_NM[2] - KNEE_LIMIT_NM) / (limits.LARGEST_NM[2] - limits.SMALLEST_NM[2])
    limits.soft_limit(robot, Ask(stream(0, "weak knees"), float(size), KNEES))


def inertia_and_friction(robot: Robot) -> None:
    """Rotors with half as much inertia again, and LuGre friction of :data:`FRICTION_NM` in all joints."""
    robot.drive.rotor_inertia_kg_m2 = (1.0 + MORE_INERTIA) * robot.drive.rotor_inertia_kg_m2
    drive.coulomb(robot, Ask(stream(0, "friction"), FRICTION_NM / drive.COULOMB_NM, ALL))


def torque_lag(robot: Robot) -> None:
    """Current loops of second order in all joints, :data:`LAG_S` late."""
    drive.slow_loop(robot, Ask(stream(0, "lag"), LAG_S / drive.LAG_S, ALL))


ROBOTS: Final[dict[str, LoopRobot]] = {
    "paper": FakeLoopRobot(HERE / "loop_paper.yaml"),
    "harsher": FakeLoopRobot(HERE / "loop_harsher.yaml"),
    "weak_knees": WithheldLoopRobot(701, weak_knees, (TorqueLimit(joints=("knees",), limit_nm=KNEE_LIMIT_NM),)),
    "inertia_friction": WithheldLoopRobot(
        702,
        inertia_and_friction,
        (
            Armature(joints=("hips",), inertia_kg_m2=MORE_INERTIA * facts.HIP_ARMATURE_KG_M2),
            Armature(joints=("knees",), inertia_kg_m2=MORE_INERTIA * facts.KNEE_ARMATURE_KG_M2),
            CoulombFriction(joints=("all",), level_nm=FRICTION_NM),
        ),
    ),
    "torque_lag": WithheldLoopRobot(703, torque_lag, (TorqueBandwidth(joints=("all",), time_constant_s=LAG_S),)),
}
"""All five, chosen before any policy was retrained."""


def robot_of(name: str) -> LoopRobot:
    """One of the five, or a fake robot by its scenario file."""
    return ROBOTS[name] if name in ROBOTS else FakeLoopRobot(Path(name))


def walk(robot: str, policy: Path, sequence: VelocitySequence, seed: int, path: Path) -> None:
    """Let a robot walk, in whichever process."""
    robot_of(robot).walk(policy, sequence, seed, path)
