import numpy as np
import pytest

from diagnosis.channels import Channel
from diagnosis.channels.build import build_views
from diagnosis.channels.stack import stack
from diagnosis.library import Location
from diagnosis.library.registry import LIBRARY
from diagnosis.library.ripple import strongest_orders
from spot_model.effects.commands import CommandDelay
from spot_model.effects.leg_odometry import LegOdometry
from spot_model.effects.registry import BUILT_IN
from spot_model.effects.torque_limits import TorqueLimit
from spot_model.io.model_file import RobotModel, model_from_data
from spot_model.policy.contract import PolicyContract
from spot_model.robot.joints import select_joints
from trainer.signals.recording import record

from .cases import ABSOLUTE, CASES, NOMINAL
from .planted import Truth, contract_json, planted_runs, walk_sequence
from .single_fit import Term, fit, fit_terms

ALL_JOINTS = np.ones(12, dtype=bool)
SEEN_ONLY = "swinging_mass"


@pytest.fixture(scope="module")
def null_views():
    runs = planted_runs(Truth(), 2, sequence=walk_sequence(2.5))
    return build_views(stack([record(r) for r in runs]), NOMINAL)[0]


def test_the_library_knows_every_effect_of_the_simulator_but_what_surrounds_a_robot():
    # Every real robot's estimator believes its standing feet; closed loops choose how much.
    # A mass that swings is seen, and simulated as if fixed.
    assert set(LIBRARY) - {SEEN_ONLY} == set(BUILT_IN) - {LegOdometry.name}
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
    assert model.effects[-1].name == entry.effect.name
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
        found = fit(LIBRARY[name], null_views, ALL_JOINTS)
        assert abs(found.coefficients[0][0]) < bound, name


def test_two_effects_fitted_together_keep_apart(null_views):
    kinds = (LIBRARY["coulomb_friction"], LIBRARY["viscous_friction"])
    together = fit_terms([Term(kind, ALL_JOINTS, {}) for kind in kinds], null_views)
    assert len(together.coefficients) == 2
    assert together.cost <= fit_terms([Term(kinds[0], ALL_JOINTS, {})], null_views).cost + 1e-6


def test_an_effect_without_its_channel_cannot_be_fitted(null_views):
    with pytest.raises(ValueError, match="command_delay: fewer than 10 usable samples in channels set_point_to_load"):
        fit(LIBRARY["command_delay"], {Channel.SET_POINT_TO_LOAD: null_views[Channel.SET_POINT_TO_LOAD]}, ALL_JOINTS)


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
    views, _ = build_views(stack([record(r) for r in runs]), NOMINAL)
    found = fit(entry, views, select_joints(case.joints))
    assert found.cost < found.cost_null
    for name, planted in case.values.items():
        if name in case.unchecked:
            continue
        expected = case.expected.get(name, planted)
        value = found.values[0][name]
        if expected == 0.0:
            unit = next(u for u in ("m_s", "rad", "kg", "m", "1") if name.endswith(f"_{u}") or u == "1")
            assert abs(value) < ABSOLUTE[unit], name
        else:
            assert value == pytest.approx(expected, rel=case.tolerance.get(name, 0.15)), name
