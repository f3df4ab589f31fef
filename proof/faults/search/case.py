"""A case of the search: one to three things that go wrong in one run, as data that can be drawn, varied and kept."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from typing import Any, Final, Literal

import numpy as np

from proof.faults.search.signals import KINDS, SIGNALS

When = Literal["up", "control", "down"]
WALK_S: Final = 2.5
MAX_FAULTS: Final = 3
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
    values: dict[str, float | str]


@dataclass(frozen=True)
class Case:
    """One run."""

    when: When
    seconds: float
    faults: tuple[Fault, ...]

    def to_json(self) -> str:
        """As one line."""
        return json.dumps(asdict(self), ensure_ascii=False)

    @staticmethod
    def from_json(text: str) -> Case:
        """What :meth:`to_json` has written."""
        content = json.loads(text)
        return Case(content["when"], content["seconds"], tuple(Fault(**fault) for fault in content["faults"]))

    @property
    def words(self) -> str:
        """In short."""
        parts = [
            f"{fault.what} at {fault.at_s:.2f} s"
            + (f" for {fault.lasts_s:.2f} s" if fault.lasts_s else "")
            + "".join(
                f", {key} {value if isinstance(value, str) else f'{value:.3g}'}" for key, value in fault.values.items()
            )
            for fault in self.faults
        ]
        return f"{self.when}: " + "; ".join(parts)


def draw(rng: np.random.Generator) -> Case:
    """A case from scratch."""
    when: When = "control" if rng.random() < 0.8 else ("up" if rng.random() < 0.5 else "down")
    count = 1 + int(rng.integers(MAX_FAULTS)) if rng.random() < 0.6 else 1
    return Case(when, WALK_S, tuple(_draw_fault(rng) for _ in range(count)))


def vary(case: Case, rng: np.random.Generator) -> Case:
    """A case near another: a fault moved, scaled, added, taken away or drawn anew."""
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
        signal, way = str(rng.choice(SIGNALS)), str(rng.choice(KINDS))
        values: dict[str, float | str] = {
            "size": float(10.0 ** rng.uniform(-2.0, 2.0)),
            "index": float(rng.integers(12)),
        }
        return Fault(f"sense {signal} {way}", at_s, lasts_s, values)
    name = str(rng.choice(list(INJECTIONS)))
    ranges = INJECTIONS[name]
    drawn: dict[str, float | str] = {
        key: str(rng.choice(choice)) if isinstance(choice[0], str) else float(rng.uniform(choice[0], choice[1]))
        for key, choice in ranges.items()
    }
    return Fault(f"inject {name}", at_s, lasts_s, drawn)


def _within(what: str, values: dict[str, Any]) -> dict[str, Any]:
    ranges = INJECTIONS.get(what.removeprefix("inject "), {})
    return {
        key: float(np.clip(value, *ranges[key])) if key in ranges and isinstance(value, float) else value
        for key, value in values.items()
    }
