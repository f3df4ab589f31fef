"""A mass on springs that the plant does not know pulls at the body; the channel of the body's wrench tells it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from diagnosis.channels import Channel
from diagnosis.channels.build import build_views
from diagnosis.channels.stack import stacked
from diagnosis.library.registry import LIBRARY
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.search import ranked
from spot_model.effects.bodies import PayloadMass
from spot_model.io.model_file import RobotModel
from spot_model.robot import facts
from spot_model.robot.rotation import rotate_inverse_wxyz, rotate_wxyz
from trainer.signals.recording import record

from .cases import NOMINAL, evidence_over
from .planted import Truth, _Recorder, walk_sequence
from .scripted_gait import ScriptedGait

MASS_KG, FREQUENCY_HZ, DAMPING, PLACE_M = 4.0, 1.5, 0.1, np.array([0.05, 0.0, 0.1])
RIVALS = ("swinging_mass", "payload_mass", "com_offset", "leg_mass", "body_inertia")


class Swinging(_Recorder):
    """Across the body the mass moves against a spring; along the vertical it is fixed."""

    def __init__(self, *given: object) -> None:
        super().__init__(*given)  # type: ignore[arg-type]
        self.pull = self.plant.batch.bind("xfrc_applied")
        self.body = self.plant.model.body("body").id
        self.off, self.speed, self.was = np.zeros((self.n, 3)), np.zeros((self.n, 3)), np.zeros((self.n, 3))

    def _step(self, step: int) -> None:
        dt, omega = self.plant.timestep_s, 2.0 * np.pi * FREQUENCY_HZ
        velocity, attitude = self.plant.linear_vel_of_body_in_world_m_s, self.plant.world_from_body_wxyz
        felt = (velocity - self.was) / dt + np.array([0.0, 0.0, 9.81])
        self.was = velocity.copy()
        felt = np.asarray(rotate_inverse_wxyz(attitude, felt))
        self.speed += dt * (-felt - omega**2 * self.off - 2.0 * DAMPING * omega * self.speed)
        self.off += dt * self.speed
        force = MASS_KG * (omega**2 * self.off + 2.0 * DAMPING * omega * self.speed)
        force[:, 2] = -MASS_KG * felt[:, 2] / (1.0 + MASS_KG / facts.TOTAL_MASS_KG)
        self.pull[:, self.body, :3] = rotate_wxyz(attitude, force)
        self.pull[:, self.body, 3:] = rotate_wxyz(attitude, np.cross(PLACE_M, force))
        super()._step(step)


def _board(recorder: type[_Recorder], truth: Truth) -> Evidence:
    runs = recorder(truth, 3, walk_sequence(5.0), ScriptedGait(), 4).runs()
    return evidence_over(runs)


def test_a_mass_that_swings_is_no_fixed_one() -> None:
    board = _board(Swinging, Truth())
    best, second = ranked(board, (), {name: LIBRARY[name] for name in RIVALS})[:2]
    term = best.terms[-1]
    assert term.effect.name == "swinging_mass"
    assert best.value > second.value + 3.0
    values = term.effect.values(best.coefficients[-1], term.shape)
    assert values["frequency_hz"] == pytest.approx(FREQUENCY_HZ, rel=0.2)
    assert values["mass_kg"] == pytest.approx(MASS_KG, rel=0.3)


def test_a_fixed_mass_does_not_swing() -> None:
    payload = PayloadMass(mass_kg=MASS_KG, x_m=0.05, z_m=0.1)
    board = _board(_Recorder, dataclasses.replace(Truth(), effects=(payload,)))
    ranking = ranked(board, (), {name: LIBRARY[name] for name in RIVALS})
    assert ranking[0].terms[-1].effect.name == "payload_mass"


def test_without_an_inertial_unit_it_cannot_be_seen() -> None:
    run = _Recorder(Truth(), 1, walk_sequence(1.0), ScriptedGait(), 4).runs()[0]
    imu = run.states.imu
    none = dataclasses.replace(imu, **{f.name: getattr(imu, f.name)[:0] for f in dataclasses.fields(imu)})
    blind = dataclasses.replace(run, states=dataclasses.replace(run.states, imu=none))
    for log, channels in ((run, (Channel.BASE_WRENCH,)), (blind, ())):
        views, _ = build_views(stacked([record(log)]), NOMINAL)
        assert Channel.BASE_WRENCH in views
        assert LIBRARY["swinging_mass"].show(views) == channels


def test_a_simulator_gets_the_mass_fixed() -> None:
    values = {"mass_kg": 3.0, "x_m": 0.1, "y_m": 0.0, "z_m": 0.2, "frequency_hz": 2.0, "damping": 0.1, "bounces": 0.0}
    made = LIBRARY["swinging_mass"].add_to(RobotModel(), values, ("all",)).effects
    assert made == (PayloadMass(mass_kg=3.0, x_m=0.1, y_m=0.0, z_m=0.2),)
