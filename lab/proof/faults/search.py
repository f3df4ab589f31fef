"""Random faults: one to three in a run, drawn, or varied from those that ended worst, and judged by what must hold."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from proof.faults.attempts import Act, inject, raise_signals
from proof.faults.rows import Finding, keep_invariants, left_alone, settle, where_it_broke
from proof.faults.spoilt_signal import SIGNALS, SLOW, WAYS, SpoiltSignal
from proof.faulty import FaultyHal, When, ending_the_bench
from proof.rig import Rig, rig
from proof.robot import tilt_rad
from spot_model.process.signals import exit_on_termination

Values = dict[str, float | str]
WALK_S: Final = 2.5
MAX_FAULTS: Final = 3
FALLEN_M: Final = 0.2
TIPPED_RAD: Final = 0.8
KEPT: Final = 12
"""Number of the worst so far that are kept and varied."""
VARIED_SHARE: Final = 0.5
_JOINTS: Final = ("fl_kn", "hr_kn", "fr_hy", "hl_hx")

INJECTIONS: Final[dict[str, dict[str, tuple[float, float] | tuple[str, ...]]]] = {
    "state_gap": {},
    "state_delay": {"delay_s": (0.001, 0.08)},
    "state_jitter": {"mean_s": (0.0005, 0.02)},
    "state_drops": {"probability": (0.05, 0.9)},
    "duplicated_states": {"probability": (0.1, 1.0)},
    "back_dated_states": {"probability": (0.1, 1.0), "shift_s": (0.001, 5.0)},
    "malformed_states": {"kind": ("eleven_joints", "cut", "noise", "empty")},
    "command_delay": {"delay_s": (0.001, 0.08)},
    "command_jitter": {"mean_s": (0.0005, 0.02)},
    "command_drops": {"probability": (0.05, 0.9)},
    "frozen_sensors": {},
    "nan_sensor": {"signal": ("position", "velocity", "load", "attitude", "body_velocity")},
    "bad_quaternion": {"scale": (0.0, 2.0)},
    "clock_jump": {"jump_s": (-2.0, 2.0)},
    "low_battery": {"percent": (0.0, 9.0)},
    "battery_fault": {},
    "motor_over_temperature": {"temperature_c": (60.0, 120.0)},
    "weak_motor": {"joint": _JOINTS, "gain": (0.0, 0.9)},
    "system_fault": {"severity": ("critical", "warn")},
    "behavior_fault": {"cause": ("fall", "hardware")},
    "power_loss": {},
    "push": {"roll_rad_s": (-10.0, 10.0), "up_m_s": (-5.0, 3.0)},
    "token_expired": {},
    "lease_stolen": {"owner": ("tablet-7",)},
    "lease_expired": {},
    "estop_pressed": {},
    "license_invalid": {"state": ("expired", "missing")},
    "time_sync_not_ready": {},
    "state_stream_closed": {},
}
"""Faults of the fake robot, with the range or the choice of each parameter."""

OPERATORS: Final = ("SIGTERM", "SIGINT", "SIGQUIT")


@dataclass(frozen=True)
class Fault:
    """One thing that goes wrong."""

    what: str
    """``inject NAME``, ``signal NAME``, or ``sense SIGNAL WAY`` for a measured signal that is spoilt on its way."""
    at_s: float
    lasts_s: float
    """0: to the end."""
    values: Values

    @property
    def words(self) -> str:
        """In short."""
        values = [f", {k} {v if isinstance(v, str) else f'{v:.3g}'}" for k, v in self.values.items()]
        lasts = f" for {self.lasts_s:.2f} s" if self.lasts_s else ""
        return f"{self.what} at {self.at_s:.2f} s{lasts}{''.join(values)}"

    def act(self) -> Act:
        """What happens when it is due."""
        kind, _, rest = self.what.partition(" ")
        if kind == "inject":
            return inject(rest, self.lasts_s, **self.values)
        if kind == "signal":
            return raise_signals(signal.Signals[rest])
        name, _, way = rest.partition(" ")
        spoilt = SpoiltSignal(name, way, int(float(self.values["index"])), float(self.values["size"]))
        if name in SLOW:
            return lambda _, hal: hal.spoil_slow(spoilt.slow, self.lasts_s)
        return lambda _, hal: hal.spoil(spoilt, self.lasts_s)


@dataclass(frozen=True)
class Case:
    """One run, as data that can be drawn, varied and kept."""

    when: When
    seconds: float
    faults: tuple[Fault, ...]

    def to_json(self) -> str:
        """The outcome as one line of JSON."""
        return json.dumps(asdict(self), ensure_ascii=False)

    @staticmethod
    def from_json(text: str) -> Case:
        """What :meth:`to_json` has written."""
        content = json.loads(text)
        return Case(content["when"], content["seconds"], tuple(Fault(**fault) for fault in content["faults"]))

    @property
    def words(self) -> str:
        """In short."""
        return f"{self.when}: " + "; ".join(fault.words for fault in self.faults)


def draw(rng: np.random.Generator) -> Case:
    """Draw a case from scratch."""
    when: When = "control" if rng.random() < 0.8 else ("up" if rng.random() < 0.5 else "down")
    count = 1 + int(rng.integers(MAX_FAULTS)) if rng.random() < 0.6 else 1
    return Case(when, WALK_S, tuple(_draw_fault(rng) for _ in range(count)))


def vary(case: Case, rng: np.random.Generator) -> Case:
    """Draw a case near another: a fault moved, scaled, added, taken away or drawn anew."""
    faults, index = list(case.faults), int(rng.integers(len(case.faults)))
    way = rng.random()
    if way < 0.3:
        at_s = float(np.clip(faults[index].at_s + rng.normal(0.0, 0.2), 0.0, WALK_S))
        faults[index] = replace(faults[index], at_s=at_s)
    elif way < 0.6:
        values = {
            k: v * float(rng.uniform(0.5, 2.0)) if isinstance(v, float) else v for k, v in faults[index].values.items()
        }
        faults[index] = replace(faults[index], values=_within(faults[index].what, values))
    elif way < 0.8 and len(faults) < MAX_FAULTS:
        faults.append(_draw_fault(rng))
    elif way < 0.9 and len(faults) > 1:
        del faults[index]
    else:
        faults[index] = _draw_fault(rng)
    return replace(case, faults=tuple(faults))


def _draw_fault(rng: np.random.Generator) -> Fault:
    at_s = float(rng.uniform(0.0, WALK_S))
    lasts_s = 0.0 if rng.random() < 0.5 else float(10.0 ** rng.uniform(-2.5, 0.3))
    kind = rng.random()
    if kind < 0.1:
        return Fault(f"signal {rng.choice(OPERATORS)}", at_s, 0.0, {})
    if kind < 0.55:
        signal, way = str(rng.choice(SIGNALS)), str(rng.choice(list(WAYS)))
        values: Values = {
            "size": float(10.0 ** rng.uniform(-2.0, 2.0)),
            "index": float(rng.integers(12)),
        }
        return Fault(f"sense {signal} {way}", at_s, lasts_s, values)
    name = str(rng.choice(list(INJECTIONS)))
    ranges = INJECTIONS[name]
    drawn: Values = {
        key: str(rng.choice(choice)) if isinstance(choice[0], str) else float(rng.uniform(choice[0], choice[1]))
        for key, choice in ranges.items()
    }
    return Fault(f"inject {name}", at_s, lasts_s, drawn)


def _within(what: str, values: Values) -> Values:
    ranges = INJECTIONS.get(what.removeprefix("inject "), {})
    return {
        key: float(np.clip(value, *ranges[key])) if key in ranges and isinstance(value, float) else value
        for key, value in values.items()
    }


@dataclass
class Verdict:
    """How a case ended."""

    case: Case
    outcome: str
    problems: list[str] = field(default_factory=list)
    badness: float = 0.0
    """What the search climbs: problems above all, then how near the robot came to a fall."""
    sentence: str = ""
    """The run's last words, to be read beside what was done to it."""


def judge_case(rig: Rig, case: Case) -> Verdict:
    """Run a case and judge its end. Leaves the robot for :meth:`Rig.restore`."""

    def begin(hal: FaultyHal) -> None:
        for fault in case.faults:
            hal.plan(fault.at_s, partial(fault.act(), rig, hal))

    try:
        with ending_the_bench():
            drive = rig.drive(begin, when=case.when, seconds=case.seconds, at_s=0.0)
    except Exception as error:  # noqa: BLE001 - a run that breaks is what is searched for
        return Verdict(case, "broke", [where_it_broke(error)], 1000.0)
    summary, truth = drive.summary, drive.hal.truth
    finding = Finding(summary.outcome, truth=truth)
    finding.demand(summary.outcome != "internal_error", f"the runtime broke: {summary.sentence}")
    is_down = truth is not None and (truth.body_height_min_m < FALLEN_M or tilt_rad(truth) > TIPPED_RAD)
    is_well = summary.outcome in ("completed", "operator_stop")
    finding.demand(not (is_down and is_well), f"the robot fell, and the run ended {summary.outcome}")
    log, why = drive.opened
    if log is None:
        finding.problems.append(f"the log does not open: {why}")
    else:
        finding.demand(log.outcome == summary.outcome or bool(log.damage), f"the log says {log.outcome}")
        keep_invariants(log, finding)
    settle(rig)
    left_alone(rig, finding)
    finding.demand(not rig.is_powered or summary.exit_code != 0, "it says that all is well, and the motors have power")
    near = 0.0 if truth is None else max(0.0, 0.5 - truth.body_height_min_m) + 0.2 * tilt_rad(truth)
    torque = 0.0 if truth is None else truth.peak_torque_nm / 1000.0
    badness = 100.0 * len(finding.problems) + near + torque
    return Verdict(case, summary.outcome, finding.problems, badness, summary.sentence)


def search_cases(seed: int, minutes: float, policy: Path, folder: Path, scenario: str = "default") -> Iterator[Verdict]:
    """Try cases for some minutes; a robot that a case leaves unusable is replaced by a new one."""
    rng, until_s = np.random.default_rng(seed), time.monotonic() + 60.0 * minutes
    worst: list[Verdict] = []
    number = 0
    while time.monotonic() < until_s:
        number += 1
        with exit_on_termination(), rig(folder / f"robot{number}", policy, scenario=scenario) as robot:
            is_usable = True
            while is_usable and time.monotonic() < until_s:
                is_varied = len(worst) == KEPT and rng.random() < VARIED_SHARE
                case = vary(worst[int(rng.integers(len(worst)))].case, rng) if is_varied else draw(rng)
                verdict = judge_case(robot, case)
                worst = sorted([*worst, verdict], key=lambda v: -v.badness)[:KEPT]
                try:
                    is_usable = not robot.restore()
                except Exception:  # noqa: BLE001 - whatever it is, the next case gets another robot
                    is_usable = False
                yield verdict
