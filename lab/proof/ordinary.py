"""``spot-rl bench ordinary``: how often an ordinary run is stopped though the simulated body does not fall."""

from __future__ import annotations

import json
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer
import yaml

from proof.drawn_robot import Push, Reality, Sensors, Walk, draw_quiet, draw_reality, draw_walk
from proof.faulty import FaultyHal, ending_the_bench
from proof.result_file import ResultFile
from proof.rig import Rig, rig
from proof.robot import tilt_rad
from spot_log.format.events import EventName
from spot_log.write.sink import MemorySink
from spot_model.console.command_registry import AsJson
from spot_model.console.progress import Progress
from spot_model.policy.built_in import policy_file
from spot_model.policy.policy import Policy, load_policy
from spot_model.process.signals import exit_on_termination
from spot_model.robot.facts import NS_PER_S, STATE_PERIOD_NS
from spot_model.robot.state import JointCommand, RobotState
from spot_runtime.hal.errors import MotionError
from spot_runtime.session.summary import RunSummary
from spot_runtime.stops import StopReason
from spot_tools.sources import ScriptedSource

EXIT_FAILED: Final = 1
POLICIES: Final = [policy_file(name) for name in ("walk", "baseline", "fast", "bound")]
_WRONG: Final = ("false stop", "fell unseen", "not begun")
TIPPED_RAD: Final = 0.7
SUNK_M: Final = 0.27
"""A body that tilts further, or is lower, at the instant of a stop, was falling by itself."""

FASTEST_RAD_S: Final = 38.0
BEFORE_FALL_S: Final = 2.0
"""What is doubted so shortly before the robot itself falls was rightly doubted."""

EDGE_M: Final = 15.0
QUIET_ONE_IN: Final = 5
"""One robot in this many has a quiet run."""


@dataclass(frozen=True)
class Outcome:
    """How one run ended."""

    number: int
    policy: str
    command: str
    """Name of the commands: ``drawn``, or what kind of quiet it was."""
    outcome: str
    sentence: str
    """Sentence about what was doubted first; otherwise about the stop."""
    verdict: str
    """``completed``, ``fell`` (the robot itself did, so that a stop was right), ``fell later`` (under the vendor's
    controller, to which it was handed back at the end), ``not begun``, ``false stop`` or ``fell unseen``."""
    control_s: float


class SensorModel:
    """States as these sensors would have shown them."""

    def __init__(self, sensors: Sensors) -> None:
        """Begin with the next state."""
        self._sensors = sensors
        self._load: Any = None

    def __call__(self, state: RobotState) -> RobotState:
        """The state as it arrives."""
        s = self._sensors
        gain = 1.0 - np.exp(-STATE_PERIOD_NS / NS_PER_S / s.load_lag_s) if s.load_lag_s > 0.0 else 1.0
        self._load = state.load_nm if self._load is None else self._load + gain * (state.load_nm - self._load)
        return replace(
            state,
            position_rad=_stepped(state.position_rad, s.position_step_rad),
            velocity_rad_s=_stepped(state.velocity_rad_s, s.velocity_step_rad_s),
            load_nm=_stepped(self._load, s.load_step_nm),
            linear_vel_of_body_in_odom_m_s=state.linear_vel_of_body_in_odom_m_s + s.velocity_bias_m_s,
            angular_vel_of_body_in_odom_rad_s=state.angular_vel_of_body_in_odom_rad_s + s.turn_rate_bias_rad_s,
        )


class WatchedHal(FaultyHal):
    """The adapter with other sensors, which looks at the body when the run is about to stop."""

    at_stop: Any = None
    stopped_ns: int = 0

    def send(self, command: JointCommand) -> None:
        """Look at the body before the first command that holds nothing."""
        if not command.gains.kp_nm_per_rad.any():
            self._look()
        super().send(command)

    def end_joint_control(self) -> None:
        """Look."""
        self._look()
        super().end_joint_control()

    def release(self) -> None:
        """Look."""
        self._look()
        super().release()

    def _look(self) -> None:
        if self.at_stop is None:
            self.at_stop, self.stopped_ns = self.robot.truth(), self.robot_now_ns()


def walk_robot(number: int, seed: int, policies: Sequence[Path], folder: Path, quiet_s: float) -> Iterator[Outcome]:
    """A robot that follows from seed and number, and a run of each policy on it; for some robots a quiet one.

    One that has fallen, or left its ground, is replaced by one of the same kind.
    """
    reality = draw_reality(np.random.default_rng([seed, number]))
    folder.mkdir(parents=True, exist_ok=True)
    scenario = folder / "scenario.yaml"
    scenario.write_text(yaml.safe_dump({"schema": "spot-rl/scenario/1", **reality.scenario}))
    left = list(policies)
    while left:
        with exit_on_termination(), ExitStack() as stack:
            robot = stack.enter_context(rig(folder / left[0].stem, left[0], scenario=str(scenario)))
            is_good = True
            while left and is_good:
                policy = left.pop(0)
                rng, walks = np.random.default_rng([seed, number, 1]), load_policy(policy)
                is_quiet = number % QUIET_ONE_IN == QUIET_ONE_IN - 1
                walk = draw_quiet(rng, quiet_s) if is_quiet else draw_walk(rng, walks.contract)
                with ending_the_bench():
                    outcome = _walk(robot, walks, reality, number, walk)
                yield outcome
                x, y, _ = robot.truth().position_of_body_in_world_m
                is_good = outcome.verdict == "completed" and max(abs(x), abs(y)) < EDGE_M and not robot.restore()


def _walk(robot: Rig, policy: Policy, reality: Reality, number: int, walk: Walk) -> Outcome:
    """One run. What the checks of the signals find is told, and ends nothing, so that it is seen what comes of it."""
    sink = MemorySink()
    hals: list[WatchedHal] = []

    def make_watched(*given: Any) -> WatchedHal:
        hals.append(WatchedHal(*given))
        hals[0].spoil(SensorModel(reality.sensors))
        return hals[0]

    def begin(hal: FaultyHal) -> None:
        for push in reality.pushes:
            hal.plan(push.at_s, partial(_push, robot, push))
        if walk.nudge is not None:
            _nudge(robot, hal, walk.nudge)

    summary = robot.drive(
        begin,
        at_s=0.0,
        source=ScriptedSource(walk.commands),
        policy=policy,
        make_sink=lambda _path, _header: sink,
        make_faulty=make_watched,
        safety={"signals": "warn"},
    ).summary
    stopped_ns = hals[0].stopped_ns or sink.events[-1].robot_stamp_ns
    doubted = [event for event in sink.events if event.name == EventName.SIGNAL_DOUBTED.label]
    doubt = next((event for event in doubted if event.robot_stamp_ns < stopped_ns), None)
    verdict = _verdict(summary, hals[0], None if doubt is None else doubt.robot_stamp_ns, robot)
    stop = "" if summary.outcome == "completed" else summary.sentence
    sentence = stop if doubt is None else doubt.text
    control_s = round(summary.control_robot_s, 2)
    return Outcome(number, policy.contract.name, walk.commands.name, summary.outcome, sentence, verdict, control_s)


def _push(robot: Rig, push: Push) -> None:
    values = {"forward_m_s": push.forward_m_s, "left_m_s": push.left_m_s, "yaw_rad_s": push.yaw_rad_s}
    robot.inject("push", 0.01, **values)


def _nudge(robot: Rig, hal: FaultyHal, nudge: Push) -> None:
    """Push now, and again after the nudge's time."""
    _push(robot, nudge)
    hal.plan(nudge.at_s, partial(_nudge, robot, hal, nudge))


def _verdict(summary: RunSummary, hal: WatchedHal, doubted_ns: int | None, robot: Rig) -> str:
    if not summary.control_robot_s:  # a robot that sits is as low as one that has fallen
        return "not begun"
    is_down = _is_down(hal.at_stop or robot.truth())
    if summary.outcome == "completed" and is_down:
        return "fell unseen"
    if doubted_ns is not None and not (is_down and hal.stopped_ns - doubted_ns < BEFORE_FALL_S * NS_PER_S):
        return "false stop"
    if summary.outcome == "completed":
        return "completed"
    fell_later = (MotionError.label, StopReason.TILT.label)
    if summary.outcome in fell_later and not is_down and _is_down(robot.truth()):
        return "fell later"
    return "fell" if is_down else "false stop"


def _is_down(truth: Any) -> bool:
    is_racing = max(abs(v) for v in truth.joint_velocity_rad_s) > FASTEST_RAD_S
    return bool(truth.has_fallen or tilt_rad(truth) > TIPPED_RAD or truth.body_height_m < SUNK_M or is_racing)


def _stepped(values: Any, step: float) -> Any:
    return np.round(values / step) * step


def ordinary(
    out: Annotated[Path, typer.Option(help="File of the outcomes, a line each; an existing one is continued.")],
    as_json: AsJson = False,
    runs: Annotated[int, typer.Option(min=1, help="Runs of each policy, each on another robot.")] = 100,
    policy: Annotated[
        list[Path] | None,
        typer.Option(parser=policy_file, metavar="POLICY", help="ONNX file or a built-in policy; repeatable."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Random seed of the robots and the commands.")] = 0,
    quiet_minutes: Annotated[
        float, typer.Option(min=0.2, max=60.0, help="Length of every fifth robot's runs, in which nothing happens.")
    ] = 10.0,
    minutes: Annotated[
        float, typer.Option(min=0.1, show_default=False, help="Start no robot after this many minutes.")
    ] = 1e6,
) -> None:
    """Walk randomly drawn robots (ground, pushes, payload, sensors, delays), or let them be; count false stops."""
    policies = policy or POLICIES
    for path in policies:
        load_policy(path)
    file = ResultFile(out, {"seed": seed})
    outcomes = [Outcome(**outcome) for outcome in file.earlier]
    done = {(outcome.number, outcome.policy): outcome for outcome in outcomes}
    left = [n for n in range(runs) if any((n, path.stem) not in done for path in policies)]
    total, began_s = runs * len(policies), time.monotonic()
    with Progress("runs", total, done=len(done)) as progress:
        for number in left:
            if time.monotonic() - began_s > 60.0 * minutes:
                break
            missing = [path for path in policies if (number, path.stem) not in done]
            with tempfile.TemporaryDirectory(prefix="spot-rl-ordinary-") as folder:
                for outcome in walk_robot(number, seed, missing, Path(folder), 60.0 * quiet_minutes):
                    done[number, outcome.policy] = outcome
                    file.add(asdict(outcome))
                    is_told = outcome.verdict in _WRONG
                    text = f"{number} {outcome.policy} {outcome.command}: {outcome.verdict} {outcome.sentence}"
                    progress.update(len(done), text, is_told=is_told)
    _tell(done, policies, seed, as_json)
    raise typer.Exit(EXIT_FAILED if any(outcome.verdict in _WRONG for outcome in done.values()) else 0)


def _tell(done: dict[tuple[int, str], Outcome], policies: list[Path], seed: int, as_json: bool) -> None:
    counts = {
        path.stem: Counter(outcome.verdict for outcome in done.values() if outcome.policy == path.stem)
        for path in policies
    }
    if as_json:
        wrong = [asdict(outcome) for outcome in done.values() if outcome.verdict in _WRONG]
        typer.echo(json.dumps({"seed": seed, "runs": counts, "wrong": wrong}, ensure_ascii=False))
        return
    for name, count in counts.items():
        typer.echo(f"{name:<10} " + ", ".join(f"{n} {verdict}" for verdict, n in sorted(count.items())))
    for outcome in done.values():
        if outcome.verdict in _WRONG:
            typer.echo(f"{outcome.number} {outcome.policy}: {outcome.verdict}: {outcome.outcome}: {outcome.sentence}")
