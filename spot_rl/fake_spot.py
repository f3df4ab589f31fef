"""A fake Spot in a process of its own, for scripts."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from typing_extensions import Self

from fake_robot.scenario.scenario import load_scenario, scenario_from_data
from fake_robot.start.process import FakeProcess
from spot_log.read.run import Run
from spot_model.errors import BadInputError, SpotRlError
from spot_model.io.model_file import RobotModel
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint, load_sequence, save_sequence
from spot_model.policy.policy import Policy
from spot_model.process.child_process import module_command, without_secrets
from spot_rl.checks import AnyPath, a_folder, flag, mapping, number, numbers, to_path, with_our_errors, wrong
from spot_rl.inputs import model_of, policy_file, read_run


class WalkError(SpotRlError):
    """A walk left no log; the message holds the runtime's last words."""


class FakeSpot:
    """A fake Spot that implements Boston Dynamics' services while the block runs.

    ::

        with FakeSpot() as spot:
            run = spot.walk("walk", velocity=(0.5, 0.0, 0.0), duration_s=3.0)

    Args:
        scenario: The robot: a scenario file, the name of a built-in one, or its keys as a mapping.
        model: The robot's effects, in place of the scenario's: a built-in name, a model file, or a model.
        lock_step: Whether robot time advances only when the runtime asks for it, as fast as the computer can. In real
            time, a busy computer ends runs with ``state_stale``.
    """

    @with_our_errors
    def __init__(
        self,
        scenario: str | AnyPath | Mapping[str, Any] = "default",
        *,
        model: str | AnyPath | RobotModel | None = None,
        lock_step: bool = True,
    ) -> None:
        self.is_lock_step = flag(lock_step, "lock_step")
        if isinstance(scenario, Mapping):
            keys = mapping(scenario, "scenario", "a mapping of keys")
            scenario_from_data(keys)  # so that a wrong key is named here
        else:
            keys = load_scenario(os.fspath(to_path(scenario, "scenario"))).to_data()
        if model is not None:
            scenario = {**keys, "model": {"effects": model_of(model)[0].to_data()["effects"]}}
            scenario_from_data(dict(scenario))
        self._scenario = scenario
        self._stack = ExitStack()
        self._running: tuple[FakeProcess, Path] | None = None
        self._walks: Counter[str] = Counter()

    @with_our_errors
    def __enter__(self) -> Self:
        """Start the robot and wait until it serves."""
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="spot-rl-")))
            # Effects of one's own are found where the script finds them.
            environment = {
                **without_secrets(os.environ),
                "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
            }
            process = stack.enter_context(
                FakeProcess(scenario=self._scenario, is_lock_step=self.is_lock_step, environment=environment)
            )
            self._stack, self._running = stack.pop_all(), (process, folder)
        return self

    def __exit__(self, *_: object) -> None:
        """End the robot."""
        self._running = None
        self._stack.close()

    @property
    def address(self) -> str:
        """``HOST:PORT``, for ``spot-rl run --robot`` and ``spot-rl serve --robot``."""
        return self._robot()[0].address.robot

    @property
    def admin(self) -> str:
        """Address of its admin service, for ``--lock-step`` where the robot is in lock-step mode."""
        return self._robot()[0].address.admin

    @property
    def sdk_host(self) -> str:
        """Host argument of a program of the vendor's SDK, which runs under ``environment``, in real time."""
        return self._robot()[0].address.sdk_host

    @property
    def environment(self) -> dict[str, str]:
        """Variables with which a program trusts and opens the fake: user name, password, certificate, Python's path."""
        return dict(self._robot()[0].address.environment)

    @with_our_errors
    def walk(
        self,
        policy: AnyPath | Policy,
        *,
        velocity: Sequence[float] | None = None,
        sequence: str | AnyPath | None = None,
        duration_s: float = 5.0,
        log_dir: AnyPath | None = None,
        labels: Mapping[str, str] | None = None,
    ) -> Run:
        """Run a policy on the robot, from sitting to sitting, and read the log.

        Args:
            policy: An ONNX file, or a policy of :func:`load_policy`.
            velocity: V_x, V_y (m/s) and ω_z (rad/s), held for the whole run; standing by default.
            sequence: In place of ``velocity``: a built-in sequence (``forward``, ``six_directions``, ``random``,
                ``standing``) or a YAML file.
            duration_s: How long the policy controls the joints, > 0, s.
            log_dir: Folder for the log; by default it is read and then deleted.
            labels: Labels of the log.

        Returns:
            The run. ``run.outcome`` says how it ended: a robot that fell has a log, too.

        Raises:
            SpotRlError: The policy is not valid, an argument is not allowed, or no log was written.
        """
        words = self._words(policy_file(policy), velocity, sequence, duration_s)
        folder = a_folder(log_dir, "log_dir") if log_dir is not None else self._robot()[1] / "logs"
        before = set(folder.glob("*.mcap"))
        words += ["--log-dir", str(folder)]
        words += [w for label in _labels(labels) for w in ("--label", label)]
        told = subprocess.run(  # noqa: S603 - our own command line
            module_command("spot_model", *words),
            env={**os.environ, **self.environment},
            capture_output=True,
            text=True,
            check=False,
        )
        made = sorted(set(folder.glob("*.mcap")) - before)
        if not made:
            said = told.stderr.strip().splitlines() or [f"exit code {told.returncode}"]
            raise WalkError(said[-1])
        return read_run(made[-1])

    def _words(
        self, policy: Path, velocity: Sequence[float] | None, sequence: str | AnyPath | None, duration_s: float
    ) -> list[str]:
        process, _ = self._robot()
        if velocity is not None and sequence is not None:
            raise BadInputError("velocity and sequence are both given; give one of them")
        duration_s = number(duration_s, "duration_s", 0.0, 3600.0, "more than 0 and up to 3600 s")
        name = str(sequence if sequence is not None else velocity)
        if sequence is not None:
            chosen = os.fspath(to_path(sequence, "sequence"))
            load_sequence(chosen)
        else:
            chosen = self._held((0.0, 0.0, 0.0) if velocity is None else velocity, duration_s)
        words = ["run", "--robot", self.address, "--policy", str(policy), "--sequence", chosen]
        words += ["--duration", str(duration_s), "--repeat", str(self._walks[name])]
        self._walks[name] += 1
        return words + (["--lock-step", process.address.admin] if self.is_lock_step else [])

    def _held(self, velocity: Sequence[float], duration_s: float) -> str:
        """A sequence file that holds one velocity."""
        allowed = "three numbers within ±10, V_x and V_y in m/s and ω_z in rad/s"
        v_x, v_y, yaw_rate = numbers(velocity, "velocity", allowed, 10.0)
        waypoint = Waypoint(time_s=0.0, v_x_m_s=v_x, v_y_m_s=v_y, yaw_rate_rad_s=yaw_rate)
        name = f"held_{v_x:g}_{v_y:g}_{yaw_rate:g}"
        path = self._robot()[1] / f"{len(self._walks)}-{sum(self._walks.values())}.yaml"
        save_sequence(VelocitySequence(name=name, duration_s=duration_s, waypoints=(waypoint,)), path)
        return str(path)

    def _robot(self) -> tuple[FakeProcess, Path]:
        if self._running is None:
            raise BadInputError("the fake robot is not running; use it in a block: with FakeSpot() as spot: ...")
        return self._running


def _labels(labels: Mapping[str, str] | None) -> list[str]:
    allowed = 'a mapping of texts, such as {"floor": "grass"}'
    given = {} if labels is None else mapping(labels, "labels", allowed)
    for key, value in given.items():
        if not key or "=" in key or not isinstance(value, (str, int, float)):
            raise wrong("labels", labels, allowed)
    return [f"{key}={value}" for key, value in given.items()]
