"""Whatever is fitted is in the model: read back number by number, and seen again in the logs of its plant."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from diagnosis.channels import Array, Views
from diagnosis.channels.build import build_views
from diagnosis.channels.stack import stacked
from diagnosis.decision_constants import ERROR_SCALES
from diagnosis.library import JointGroups, LibraryEffect
from diagnosis.library.held import OF_CHANNEL_ONLY, groups_of
from diagnosis.library.registry import LIBRARY
from diagnosis.library.rigid_body import body_of
from diagnosis.selection.ordinary_errors import ErrorKind, error_sets
from diagnosis.selection.robot_models import effects_merged, model_by_joint, with_kind
from spot_model.effects.base import Effect, ModelEffect
from spot_model.effects.bodies import ComOffset, PayloadMass
from spot_model.effects.commands import CommandDelay
from spot_model.effects.friction import Armature, CoulombFriction, ViscousFriction
from spot_model.io.model_file import RobotModel, load_model, save_model
from spot_model.plant.model_fields import MujocoFields, edit_model
from spot_model.policy.policy import load_policy
from spot_model.robot.facts import JOINT_NAMES
from spot_model.robot.mjcf import MjcfOptions, spot_mjcf
from trainer.signals.recording import record
from trainer.simulate.recorded_runs import UsualNoise, simulate_scripts

from .cases import NOMINAL
from .planted import POLICY, Truth, planted_runs, scripts, walk_sequence

SPOT = JointGroups(JOINT_NAMES, np.repeat(np.arange(4), 3))
HELD = RobotModel(
    (
        CoulombFriction(joints=("hips",), level_nm=0.05),
        CoulombFriction(joints=("knees",), level_nm=0.4),
        ViscousFriction(damping_nm_s_per_rad=0.05),
        Armature(joints=("knees",), inertia_kg_m2=0.02),
        PayloadMass(mass_kg=4.0, x_m=0.1, z_m=0.12),
        CommandDelay(delay_s=0.005),
    )
)
NOMINALS = {"bare": RobotModel(), "held": HELD}
BODY = "payload_mass"
BY_PLACE = {n for n in ERROR_SCALES if issubclass(LIBRARY[n].effect, ModelEffect)} - {
    BODY,
    "com_offset",
    "body_inertia",
}


def kind_of(name: str) -> ErrorKind:
    """Errors of an effect with a published range."""
    entry, given = LIBRARY[name], ERROR_SCALES[name]
    chosen = np.flatnonzero([given.scales.get(c.name, 0.0) > 0.0 for c in entry.coefficients])
    return ErrorKind(entry, given.at, 0, tuple(error_sets(SPOT, entry)), chosen)


def spreads(name: str) -> Array:
    """Published spread of each coefficient, 0 where none is published; shape (C,)."""
    return np.array([ERROR_SCALES[name].scales.get(c.name, 0.0) for c in LIBRARY[name].coefficients])


def n_units(name: str) -> int:
    """Joints, legs, or one."""
    return len(SPOT.units(LIBRARY[name].location))


def read(model: RobotModel, name: str) -> Array:
    """What a model's effects of a kind come from: coefficients by unit, shape (U, C)."""
    if name == BODY:
        mass_kg, com_m = body_of(model.effects)
        return np.array([[mass_kg, *(mass_kg * com_m)]])
    entry, at, units = LIBRARY[name], ERROR_SCALES[name].at, SPOT.units(LIBRARY[name].location) > 0.5
    found = np.zeros((len(units), len(entry.coefficients)))
    for effect in model.effects:
        for joints, values in groups_of(effect) if isinstance(effect, entry.effect) else ():
            own, shape = entry.inverse(values)
            for k, c in enumerate(entry.coefficients):
                if not c.is_free:
                    size = next(iter(at.keys() & shape.keys()))
                    own[k] = shape[size] / at[size]
            found += np.outer((units & joints).any(axis=1), own)
    return found


def parameter_of(entry: LibraryEffect, k: int) -> str:
    """The parameter that a coefficient moves, where it moves one."""
    if entry.name == "sensor_noise":
        return entry.effect.parameters()[k].name
    c = entry.coefficients[k]
    return c.name if c.is_free else next(iter(ERROR_SCALES[entry.name].at))


def check(before: RobotModel, after: RobotModel, name: str, asked: Array) -> None:
    """Every number is there, or at its parameter's bound."""
    found, entry = read(after, name) - read(before, name), LIBRARY[name]
    of_model = [k for k, c in enumerate(entry.coefficients) if c.name not in OF_CHANNEL_ONLY.get(name, ())]
    for unit, k in ((unit, k) for unit in range(len(asked)) for k in of_model):
        if found[unit, k] == pytest.approx(asked[unit, k], abs=1e-6 * max(1.0, abs(asked[unit, k]))):
            continue
        p = next(p for p in entry.effect.parameters() if p.name == parameter_of(entry, k))
        mask = SPOT.units(entry.location)[unit] > 0.5
        own = [v for e in after.effects if isinstance(e, entry.effect) for j, v in groups_of(e) if (j & mask).any()]
        bound = p.low if asked[unit, k] < found[unit, k] else p.high
        assert p.null + sum(v[p.name] - p.null for v in own) == pytest.approx(bound, abs=1e-12), (unit, p.name)


@pytest.mark.parametrize("nominal", NOMINALS)
@pytest.mark.parametrize("name", ERROR_SCALES)
def test_each_number_by_itself_comes_back_from_the_model(name: str, nominal: str) -> None:
    before, kind, n = NOMINALS[nominal], kind_of(name), n_units(name)
    for times in (1.0, -1.0, 3.0, -3.0, 6.0, -6.0):
        for k in kind.chosen:
            for at in (np.arange(n) == n // 2, np.ones(n)):
                asked = np.outer(at, times * spreads(name) * (np.arange(len(kind.effect.coefficients)) == k))
                after = with_kind(before, SPOT, kind, asked)
                check(before, after, name, asked)


def all_drawn(before: RobotModel, rng: np.random.Generator, times: float) -> tuple[RobotModel, Mapping[str, Array]]:
    """A model with every kind's numbers at once, as drawn."""
    after, drawn = before, {}
    for name in ERROR_SCALES:
        drawn[name] = times * spreads(name) * rng.standard_normal((n_units(name), len(spreads(name))))
        after = with_kind(after, SPOT, kind_of(name), drawn[name])
        check(before, after, name, drawn[name])
    return after, drawn


@pytest.mark.parametrize("nominal", NOMINALS)
@pytest.mark.parametrize("times", [1.0, 3.0, 6.0])
def test_all_numbers_together_come_back_from_the_model_and_from_its_file(
    nominal: str, times: float, tmp_path: Path
) -> None:
    after, _ = all_drawn(NOMINALS[nominal], np.random.default_rng(int(times)), times)
    plain = model_by_joint(effects_merged(after), JOINT_NAMES)
    save_model(plain, tmp_path / "model.yaml")
    loaded = load_model(str(tmp_path / "model.yaml"))
    assert loaded.digest() == plain.digest()
    for name in ERROR_SCALES:
        assert read(loaded, name) == pytest.approx(read(after, name), rel=1e-9, abs=1e-9), name


def test_a_model_that_is_corrected_again_does_not_grow() -> None:
    rng = np.random.default_rng(3)
    once = model_by_joint(effects_merged(all_drawn(RobotModel(), rng, 1.0)[0]), JOINT_NAMES)
    twice = once
    for name in ERROR_SCALES:
        drawn = 0.5 * spreads(name) * rng.standard_normal((n_units(name), len(spreads(name))))
        twice = with_kind(twice, SPOT, kind_of(name), drawn)
    names = [e.name for e in effects_merged(twice).effects]
    # Effects on the model's fields stand by joint or leg, of which there are twelve.
    for name in set(names):
        assert names.count(name) <= (12 if name in BY_PLACE else 1), name


def test_no_error_changes_nothing() -> None:
    for name in ERROR_SCALES:
        none = np.zeros((n_units(name), len(spreads(name))))
        assert with_kind(HELD, SPOT, kind_of(name), none).digest() == HELD.digest()


def test_coefficients_are_in_the_model_or_known_to_be_of_a_channel_only() -> None:
    for name in ERROR_SCALES:
        entry = LIBRARY[name]
        for k, c in enumerate(entry.coefficients):
            asked = np.zeros((n_units(name), len(entry.coefficients)))
            asked[:, k] = 1e-4
            after = with_kind(RobotModel(), SPOT, kind_of(name), asked)
            assert (after == RobotModel()) == (c.name in OF_CHANNEL_ONLY.get(name, ())), (name, c.name)
    assert all({*own} <= {c.name for c in LIBRARY[name].coefficients} for name, own in OF_CHANNEL_ONLY.items())


# ---- the body's mass and first moments


@pytest.mark.parametrize("mass_kg", [0.0, 1e-3, 0.1, -0.1, 0.6, -3.0, 3.0, 12.0])
@pytest.mark.parametrize("moment_kg_m", [(0.0, 0.0, 0.0), (0.5, -0.2, 0.3), (-1.5, 0.6, 0.9)])
def test_the_simulated_body_has_the_mass_and_first_moments_of_the_fit(
    mass_kg: float, moment_kg_m: tuple[float, float, float]
) -> None:
    for nominal in (RobotModel(), HELD):
        mass, moment, _ = simulated_body(nominal)
        for model in (
            with_kind(nominal, SPOT, kind_of(BODY), np.array([[mass_kg, *moment_kg_m]])),
            LIBRARY[BODY].add_to(nominal, LIBRARY[BODY].values(np.array([mass_kg, *moment_kg_m]), {}), ("all",)),
        ):
            new_mass, new_moment, _ = simulated_body(model)
            assert new_mass - mass == pytest.approx(mass_kg, abs=2e-9)
            assert new_moment - moment == pytest.approx(np.array(moment_kg_m), abs=1e-8)
            assert body_of(model.effects)[0] == pytest.approx(new_mass)


def test_what_is_no_payload_adds_no_inertia_and_a_payload_its_own() -> None:
    body = kind_of(BODY)
    _, _, bare = simulated_body(RobotModel())
    # Half a kilogram whose first moments would put it at the nose, and a centre of mass that lies elsewhere.
    for own in ([0.5, 0.2, 0.0, 0.15], [-2.0, 0.3, 0.1, 0.0], [0.0, 0.6, 0.0, 0.0]):
        assert simulated_body(with_kind(RobotModel(), SPOT, body, np.array([own])))[2] == pytest.approx(bare)
    payload = PayloadMass(mass_kg=4.0, x_m=0.1, z_m=0.12)
    fitted = with_kind(RobotModel(), SPOT, body, np.array([[4.0, 0.4, 0.0, 0.48]]))
    assert fitted == RobotModel((payload,))
    # Beside nothing at all, a place outside the body's reach is its centre of mass that moved.
    far = with_kind(RobotModel(), SPOT, body, np.array([[2.0, 1.6, 0.0, 0.0]]))
    assert [e.name for e in far.effects] == [PayloadMass.name, ComOffset.name]


def test_a_centre_of_mass_is_held_where_it_can_be() -> None:
    model = with_kind(RobotModel(), SPOT, kind_of(BODY), np.array([[0.0, 0.0, 3.0, 0.0]]))
    assert body_of(model.effects)[1][1] == pytest.approx(0.1)


def simulated_body(model: RobotModel) -> tuple[float, Array, Array]:
    """Mass, first moments and inertia about its centre of mass of the body that MuJoCo gets."""
    made = mujoco.MjModel.from_xml_string(spot_mjcf(MjcfOptions(collision="feet", visuals=False)))
    fields = MujocoFields(made)
    edit_model(made, model.effects)
    at = fields.body_id("body")
    mass = float(fields["body_mass"][0, at])
    return mass, mass * fields["body_ipos"][0, at].astype(float), fields["body_inertia"][0, at].astype(float)


# ---- the plant


def test_a_model_with_all_kinds_is_simulated() -> None:
    model, _ = all_drawn(HELD, np.random.default_rng(5), 1.0)
    policy = load_policy(POLICY)
    plain = model_by_joint(effects_merged(model), JOINT_NAMES)
    rows = []
    for own in (model, plain, HELD):
        run = simulate_scripts(own, policy, scripts(25)[:1], np.random.default_rng(0), UsualNoise())[0]
        assert np.isfinite(run.states.position_rad).all()
        rows.append(run.states.load_nm[:40])
    # What merges is the same up to the order of small effects.
    assert np.sqrt(np.mean((rows[1] - rows[0]) ** 2)) < 0.3 * np.sqrt(np.mean((rows[2] - rows[0]) ** 2))


SIZES = {"ground_friction": -3.0, "sensor_noise": 3.0, "command_drop": 60.0}
"""In published spreads, where five are too many for a formula or show nothing: a foot that slips no more, two commands
of a hundred."""
TOLERANCES = {
    "load_filter": 0.3,
    "sensor_noise": 0.5,
    "ground_compliance": 0.35,
    "command_jitter": 0.3,
    "command_drop": 0.35,
}
"""Of formulas that are known to be rough (:mod:`.cases`); 0.2 for all others.

A simulated filter takes a reading to have held since the one before, and so lags by half a step less than it says.
"""


@cache
def planted_views(effects: tuple[Effect, ...]) -> Views:
    runs = planted_runs(Truth(effects), 1, sequence=walk_sequence(2.0))
    return build_views(stacked([record(r) for r in runs]), NOMINAL)[0]


def fitted(entry: LibraryEffect, shape: Mapping[str, float], views: Views) -> Array:
    """Coefficients at all units by least squares over the effect's channels, outliers counting less; shape (C,)."""
    xs, ys, robust = [], [], []
    for view in (views[c] for c in entry.channels if c in views):
        weight = view.usable / np.broadcast_to(view.noise, view.response.shape)
        x = entry.columns(view, shape, np.ones(12, dtype=bool)) * weight[:, :, None]
        xs.append(x[weight > 0.0])
        ys.append((view.response * weight)[weight > 0.0])
        robust.append(np.full(len(ys[-1]), view.is_robust))
    x, y = np.concatenate(xs), np.concatenate(ys)
    size = np.maximum(np.linalg.norm(x, axis=0), 1e-12)
    found, least = np.zeros(x.shape[1]), np.ones(len(y))
    for _ in range(6):
        found = np.linalg.lstsq(x / size * least[:, None], y * least, rcond=1e-8)[0] / size
        off = np.abs(y - x @ found)
        bound = np.where(np.concatenate(robust), 2.2 * np.median(off), np.inf)
        least = np.sqrt(np.minimum(1.0, bound / np.maximum(off, 1e-12)))
    return found


@pytest.mark.parametrize("name", ERROR_SCALES)
def test_the_plant_moves_by_what_the_columns_predict(name: str) -> None:
    entry, given, kind = LIBRARY[name], ERROR_SCALES[name], kind_of(name)
    asked = SIZES.get(name, 5.0) * spreads(name)
    model = with_kind(RobotModel(), SPOT, kind, np.tile(asked, (n_units(name), 1)))
    shape = {**{k: tried[0] for k, tried in entry.grid.items()}, **given.at}
    expected = asked.copy()
    for k in kind.chosen:
        if not entry.coefficients[k].is_free:
            shape, expected[k] = {n: asked[k] * v for n, v in given.at.items()}, 1.0
    found = fitted(entry, shape, planted_views(model.effects)) - fitted(entry, shape, planted_views(()))
    for k in kind.chosen:
        assert found[k] == pytest.approx(expected[k], rel=TOLERANCES.get(name, 0.2)), entry.coefficients[k].name
