"""Small realities for the tests: quick robots of the package's simulator with four kinds of faults."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from spot_model.io.model_file import RobotModel
from withheld.plan import FaultRequest, RecordingPlan, Truth
from withheld.realities.fault_kind import Ask, FaultKind, Parameters, at
from withheld.realities.reality import make
from withheld.realities.source import CATALOGUES
from withheld.simulator.parameters import Settings
from withheld.simulator.robot import Law, Robot
from withheld.simulator.simulation import RealityDivergedError

CATALOGUE = CATALOGUES["calibrating"]
QUICK = Settings(settle_s=0.3, ramp_s=0.25, tail_s=0.05)


def _odd(robot: Robot, ask: Ask) -> Parameters:
    pull = at(ask.joints, 8.0 * ask.size)
    robot.rotors.append(Law(lambda torque, m: torque - pull * m.rotor_rad**2))
    return {}


KINDS: dict[str, FaultKind] = {
    **{name: CATALOGUE[name] for name in ("flux_change", "lugre_friction", "box_on_the_back")},
    "odd": FaultKind("odd", "friction", (), ("joint",), _odd),
}


class Alone:
    """Chooses what is hidden by itself."""

    def __init__(self, seed: int, requests: Sequence[FaultRequest] | None = None) -> None:
        if requests is None:
            kind = ("", "flux_change", "lugre_friction")[int(np.random.default_rng(seed).integers(3))]
            requests = (FaultRequest(kind=kind, place="type", size=0.8),) if kind else ()
        self._made = replace(make(requests, seed, KINDS, error_scale=0.5), settings=QUICK)

    @property
    def truth(self) -> Truth:
        return self._made.truth

    @property
    def nominal(self) -> RobotModel:
        return self._made.nominal

    def record(self, plan: RecordingPlan, folder: Path) -> None:
        self._made.record(plan, folder)


class StandIn(Alone):
    """The same with kinds that a draw may ask for."""

    KINDS = KINDS


class Brittle(StandIn):
    """The first robot of every case breaks its simulation."""

    attempts: ClassVar[dict[str, int]] = {}

    def record(self, plan: RecordingPlan, folder: Path) -> None:
        name = repr(plan.sequences)
        self.attempts[name] = self.attempts.get(name, 0) + 1
        if self.attempts[name] == 1:
            raise RealityDivergedError("not a number")
        super().record(plan, folder)
