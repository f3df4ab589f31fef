"""What the library knows of how some effects act in time, each against a case worked out by hand."""

from collections.abc import Mapping

import numpy as np
import pytest

from diagnosis.channels import Channel, Flags, Views
from diagnosis.channels.build import build_views
from diagnosis.channels.stack import stacked
from diagnosis.decision_constants import ERROR_SCALES
from diagnosis.library import JointGroups, LibraryEffect, Location
from diagnosis.library.held import IN_CHANNELS, groups_of, less_held
from diagnosis.library.registry import LIBRARY
from diagnosis.library.ripple import strongest_orders
from diagnosis.selection.evidence import lay_out
from diagnosis.selection.scoring import Scored, Scorer
from spot_model.effects.bodies import StowedArm
from spot_model.effects.commands import CommandDelay
from spot_model.effects.leg_odometry import LegOdometry
from spot_model.effects.registry import BUILT_IN
from spot_model.effects.torque_limits import TorqueLimit
from spot_model.io.model_file import RobotModel, model_from_data
from spot_model.policy.contract import PolicyContract
from spot_model.robot.facts import JOINT_NAMES
from spot_model.robot.joints import select_joints
from trainer.signals.motor_torque import presliding
from trainer.signals.recording import record

from .cases import ABSOLUTE, CASES, NOMINAL
from .planted import Truth, contract_json, planted_runs, walk_sequence

pytestmark = pytest.mark.slow

ROBOT = JointGroups(JOINT_NAMES, np.repeat(np.arange(4), 3))
BESIDE = "command_drop"
REFINEMENTS = 8
"""Rounds around the best shape, at most; they end when none is better."""


ALL_JOINTS = np.ones(12, dtype=bool)
SEEN_ONLY = "swinging_mass"


def fit(effect: LibraryEffect, views: Views, joints: Flags) -> tuple[Scored, Mapping[str, float]]:
    """The effect with the best of its shapes, tried coarsely and then finer around the best; and its parameters.

    ``joints`` is where it acts, shape (J,).
    """
    own = {
        c: v for c, v in views.items() if c in effect.channels or c in (Channel.TIME_STAMPS, Channel.SET_POINT_TO_LOAD)
    }
    n_runs = int(max(v.run.max() for v in own.values())) + 1
    board = lay_out(
        own,
        ROBOT,
        range(n_runs),
        [str(k) for k in range(n_runs)],
        library=LIBRARY,
        scales={BESIDE: ERROR_SCALES[BESIDE]},
    )
    scorer = Scorer(board)
    place = ROBOT.units(effect.location)[:, joints].max(axis=1) if effect.location is not Location.ROBOT else np.ones(1)
    best: Scored | None = None
    # The planted battery's own numbers are not those of a planted supply.
    shapes, tried = effect.shapes(own, joints), set()
    for _ in range(REFINEMENTS + 1):
        before = best
        for shape in shapes:
            key = tuple(sorted(shape.items()))
            if key not in tried:
                tried.add(key)
                found = scorer.scored(effect, shape, place)
                best = found if best is None or found.value > best.value else best
        if best is before or best is None:
            break
        shapes = effect.refined(best.terms[-1].shape)
    assert best is not None
    return best, effect.values(best.coefficients[-1], best.terms[-1].shape)


@pytest.fixture(scope="module")
def null_views():
    runs = planted_runs(Truth(), 2, sequence=walk_sequence(2.5))
    return build_views(stacked([record(r) for r in runs]), NOMINAL)[0]


def test_the_library_knows_every_effect_of_the_simulator_but_what_surrounds_a_robot():
    # Every real robot's estimator believes its standing feet; closed loops choose how much.
    # A mass that swings is seen, and simulated as if fixed. Whether there is an arm, the robot says.
    assert set(LIBRARY) - {SEEN_ONLY} == set(BUILT_IN) - {LegOdometry.name, StowedArm.name}
    assert all(entry.effect is BUILT_IN[name] for name, entry in LIBRARY.items() if name != SEEN_ONLY)


def test_every_effect_has_a_planted_case():
    assert {case.effect for case in CASES} == set(LIBRARY) - {SEEN_ONLY}


@pytest.mark.parametrize("name", LIBRARY)
def test_what_an_entry_says_of_itself(name):
    entry = LIBRARY[name]
    assert entry.confused_with
    assert set(entry.confused_with) <= set(LIBRARY) - {name}
    assert entry.title
    assert entry.channels
    assert entry.split_by.text.endswith(".")
    contract = PolicyContract.from_json(contract_json())
    low, high = np.array(contract.velocity_command_low), np.array(contract.velocity_command_high)
    assert entry.split_by.sequence.clipped(low, high).duration_s > 0.0


@pytest.mark.parametrize("name", LIBRARY)
def test_columns_touch_the_rows_of_their_joints_alone(name, null_views):
    entry = LIBRARY[name]
    joints = select_joints(("fl",)) if name != "position_torque_limit" else select_joints(("fl_kn",))
    shape = entry.shapes(null_views, joints)[0]
    for channel in entry.show(null_views):
        view = null_views[channel]
        columns = entry.columns(view, shape, joints)
        assert columns.shape == (view.n, len(view.rows), len(entry.coefficients))
        legs = np.isin(view.row_leg, [-1, 0])
        outside = ~select_joints(("fl",))[view.row_joint] if view.name in entry.separable else ~legs
        # A height is measured against the mean of all standing feet, so other legs' heights move a little.
        outside &= np.array(["height" not in row for row in view.rows])
        outside &= entry.location is not Location.ROBOT
        assert np.max(np.abs(columns[:, outside]), initial=0.0) < 1e-9


@pytest.mark.parametrize("name", LIBRARY)
def test_found_values_make_an_effect_that_a_model_takes(name, null_views):
    entry = LIBRARY[name]
    shapes = entry.shapes(null_views, ALL_JOINTS)
    shape = (*entry.refined(shapes[-1]), *shapes)[0]
    middle = np.array([0.5 * (max(c.low, -0.01) + min(c.high, 0.01)) for c in entry.coefficients])
    values = entry.values(middle, shape)
    model = entry.add_to(RobotModel(), values, ("all",))
    assert entry.effect.name in {e.name for e in model.effects}
    assert model_from_data(model.to_data()).digest() == model.digest()


def test_a_nominal_reality_gives_nearly_nothing(null_views):
    for name, bound in (
        ("coulomb_friction", 0.06),
        ("viscous_friction", 0.02),
        ("armature", 0.001),
        ("torque_gain", 0.01),
        ("encoder_offset", 0.003),
        ("payload_mass", 0.1),
        ("com_offset", 0.003),
        ("command_delay", 3e-4),
        ("contact_delay", 3e-3),
    ):
        found, _ = fit(LIBRARY[name], null_views, ALL_JOINTS)
        assert abs(found.coefficients[0][0]) < bound, name


def test_a_found_delay_replaces_the_nominal_one():
    model = RobotModel((CommandDelay(delay_s=0.005),))
    shorter = LIBRARY["command_delay"].add_to(model, {"delay_s": -0.002}, ("all",))
    assert [e.delay_s for e in shorter.effects] == [pytest.approx(0.003)]
    gone = LIBRARY["command_delay"].add_to(model, {"delay_s": -0.02}, ("all",))
    assert gone.effects[-1].is_null


def test_a_looser_limit_replaces_the_nominal_one_at_its_place():
    hips = TorqueLimit(joints=("hx", "hy"), limit_nm=45.0)
    knees = TorqueLimit(joints=("kn",), limit_nm=80.0)
    model = LIBRARY["torque_limit"].add_to(RobotModel((hips, knees)), {"limit_nm": 60.0}, ("hx", "hy"))
    assert [(e.joints, e.limit_nm) for e in model.effects] == [(("kn",), 80.0), (("hx", "hy"), 60.0)]


def test_the_order_spectrum_finds_a_line_at_any_speed():
    rng = np.random.default_rng(5)
    angle = 0.6 * np.sin(np.linspace(0.0, 37.0, 4000)) + 0.3 * np.sin(np.linspace(0.0, 91.0, 4000))
    residual = 0.3 * np.sin(83.0 * angle + 1.0) + 0.3 * rng.standard_normal(4000)
    found = strongest_orders(angle[:, None], residual[:, None], np.ones((4000, 1), dtype=bool))
    assert min(abs(n - 83.0) for n in found) <= 0.5


@pytest.mark.parametrize("case", CASES, ids=[c.label for c in CASES])
def test_a_planted_effect_is_recovered_by_its_own_channels(case):
    entry = LIBRARY[case.effect]
    effect = entry.effect(joints=case.joints, **case.values)
    runs = planted_runs(Truth(effects=(effect,)), case.runs, sequence=walk_sequence(case.duration_s))
    views, _ = build_views(stacked([record(r) for r in runs]), NOMINAL)
    found, values = fit(entry, views, select_joints(case.joints))
    assert found.value > 0.0
    for name, planted in case.values.items():
        if name in case.unchecked:
            continue
        expected = case.expected.get(name, planted)
        value = values[name]
        if expected == 0.0:
            unit = next(u for u in ("m_s", "rad", "kg", "m", "1") if name.endswith(f"_{u}") or u == "1")
            assert abs(value) < ABSOLUTE[unit], name
        else:
            assert value == pytest.approx(expected, rel=case.tolerance.get(name, 0.15)), name
    # A nominal model that holds the effect leaves little of it to be found again.
    if isinstance(effect, IN_CHANNELS) and case.effect != "ground_compliance":
        held, _ = build_views(stacked([record(r) for r in runs]), NOMINAL.with_effects(effect))
    else:
        held = less_held(views, (effect,), LIBRARY)
    again, _ = fit(entry, held, select_joints(case.joints))
    assert again.value < 0.25 * found.value


@pytest.mark.parametrize("case", CASES, ids=[c.label for c in CASES])
def test_coefficients_come_back_from_their_values(case):
    entry = LIBRARY[case.effect]
    effect = entry.effect(joints=case.joints, **case.values)
    if not isinstance(effect, IN_CHANNELS) or case.effect == "ground_compliance":
        coefficients, shape = entry.inverse(effect.values)
        assert {k: v for k, v in entry.values(coefficients, shape).items() if k in case.values} == pytest.approx(
            dict(case.values)
        )


def test_joints_with_the_same_numbers_are_one_group():
    offset = BUILT_IN["encoder_offset"](joints=("kn",), offset_rad=np.array([[0.0, 0.0, 0.01, 0.0, 0.0, 0.02] * 2]))
    groups = [(np.flatnonzero(joints).tolist(), values) for joints, values in groups_of(offset)]
    assert groups == [([2, 8], {"offset_rad": 0.01}), ([5, 11], {"offset_rad": 0.02})]


def test_dry_friction_builds_up_over_its_distance_and_turns_with_the_motion() -> None:
    there = np.linspace(0.0, 0.1, 101)
    position = np.concatenate([there, there[-2::-1]])[:, None]
    felt = presliding(position, np.zeros(len(position), dtype=np.intp), 0.01)[:, 0]
    assert felt[10] == pytest.approx(1.0 - np.exp(-1.0))
    assert felt[100] == pytest.approx(1.0, abs=1e-3)
    assert felt[110] == pytest.approx(-1.0 + 2.0 * np.exp(-1.0), abs=1e-3)
    assert felt[-1] == pytest.approx(-1.0, abs=1e-3)


def test_dry_friction_begins_anew_with_each_recording() -> None:
    position = np.array([0.0, 1.0, 5.0, 5.0])[:, None]
    assert presliding(position, np.array([0, 0, 1, 1]), 0.01)[:, 0].tolist() == pytest.approx([0.0, 1.0, 0.0, 0.0])
