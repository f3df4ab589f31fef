"""Short runs for the tests: half a second of walking after a short stand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np

from spot_model.io.velocity_sequence import VelocitySequence, Waypoint
from spot_model.policy.policy import Policy, load_policy
from withheld.plan import FaultRequest
from withheld.realities.fault_kind import FaultKind
from withheld.realities.reality import make
from withheld.simulator.parameters import Settings
from withheld.simulator.recorder import RunArrays
from withheld.simulator.simulation import RunRequest, simulate

POLICIES = Path(__file__).parents[3] / "policies"
QUICK = Settings(settle_s=0.3, ramp_s=0.25, tail_s=0.05)
BRIEF = Settings(settle_s=0.1, ramp_s=0.1, tail_s=0.02)


@cache
def policy(name: str = "walk") -> Policy:
    """A committed policy."""
    return load_policy(POLICIES / f"{name}.onnx")


def ahead(duration_s: float, v_x_m_s: float = 1.0) -> VelocitySequence:
    """Forward from the start."""
    return VelocitySequence(name="ahead", duration_s=duration_s, waypoints=(Waypoint(time_s=0.0, v_x_m_s=v_x_m_s),))


def widest(kind: FaultKind, size: float = 1.0) -> FaultRequest:
    """A fault at the widest place that its kind allows."""
    place = next((p for p in ("all", "type") if p in kind.places), kind.places[0])
    return FaultRequest(kind=kind.name, place=place, size=size)


def short_run(
    requests: Sequence[FaultRequest] = (),
    catalogue: Mapping[str, FaultKind] | None = None,
    duration_s: float = 0.5,
    settings: Settings = QUICK,
) -> RunArrays:
    """One run of the robot of seed 5."""
    made = make(requests, 5, catalogue or {}, error_scale=1.0)
    return simulate(made.robot(), policy(), [RunRequest(ahead(duration_s), np.random.default_rng(2))], settings)[0]


@cache
def brief(kind: FaultKind | None = None) -> RunArrays:
    """A third of a second of walking after a shorter stand still, with a fault at its widest or without any."""
    faults = [] if kind is None else [widest(kind)]
    return short_run(faults, {} if kind is None else {kind.name: kind}, 0.3, BRIEF)
