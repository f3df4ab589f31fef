"""What is right and what is wrong, case by case, worked out by hand."""

import pytest

from withheld.outcome import Outcome, Round
from withheld.scoring.scores import causes, claims, f1, is_right, located, parameters, score
from withheld.scoring.sizes import Size, is_outside, size_of, sizes
from withheld.scoring.table import breakdown, table
from withheld.verdict import Number, Seen

from .made_up import KNEES, fault, outcome, said, verdict

COULOMB = fault("coulomb_friction", coulomb_friction__level_nm=2.0)
GAIN = fault("torque_gain", joints=("fl_hy",), torque_gain__gain=0.8)


def test_a_faults_size_is_how_far_it_moves_the_gap() -> None:
    assert [size_of(m) for m in (2.0, 1.9, 0.5, 0.4, None)] == [
        Size.LARGE,
        Size.BETWEEN,
        Size.BETWEEN,
        Size.SMALL,
        Size.UNMEASURED,
    ]
    assert sizes(outcome([COULOMB, GAIN], moved=(3.0, 0.1))) == (Size.LARGE, Size.SMALL)
    assert sizes(outcome([COULOMB], moved=())) == (Size.UNMEASURED,)


@pytest.mark.parametrize(
    ("o", "right"),
    [
        (outcome([COULOMB], [said("coulomb_friction")]), True),
        (outcome([COULOMB], [said("load_friction", "coulomb_friction", "armature")]), True),
        (outcome([COULOMB], [said("a", "b", "c", "coulomb_friction")]), False),
        (outcome([COULOMB], [said("coulomb_friction"), said("armature")]), False),
        (outcome([COULOMB], [said("coulomb_friction"), said("coulomb_friction")]), False),
        (outcome([COULOMB], [said("coulomb_friction")], "unknown_effect"), False),
        (outcome([COULOMB]), False),
        (outcome([COULOMB], status="failed"), False),
        (outcome([COULOMB, GAIN], [said("torque_gain"), said("coulomb_friction")]), True),
        (outcome([COULOMB, GAIN], [said("torque_gain")]), False),
        (outcome([COULOMB, GAIN], [said("torque_gain")], moved=(0.1, 3.0)), True),
        (outcome([COULOMB, GAIN], [said("torque_gain"), said("coulomb_friction")], moved=(0.1, 3.0)), True),
        (outcome([COULOMB, GAIN], [said("torque_gain")], moved=(1.0, 1.0)), None),
        (outcome([COULOMB], moved=(0.1,)), True),
        (outcome([COULOMB], [said("coulomb_friction")], moved=(0.1,)), False),
        (outcome([COULOMB], moved=(None,)), None),
        (outcome(), True),
        (outcome((), [said("armature")]), False),
        (outcome((), status="unknown_effect"), False),
        (outcome((), status="cannot_tell"), True),
        (outcome((), status="failed"), False),
        (outcome([fault()], status="unknown_effect"), True),
        (outcome([fault()], [said("armature")]), False),
        (outcome([fault()]), False),
        (outcome([fault()], moved=(0.1,)), True),
        (outcome([COULOMB], status="unknown_effect", without=["coulomb_friction"]), True),
        (outcome([COULOMB], [said("coulomb_friction")], without=["coulomb_friction"]), False),
    ],
)
def test_right_is_what_a_perfect_diagnosis_says(o: Outcome, right: bool | None) -> None:
    assert is_right(o) is right


def test_what_a_verdict_lists_beside_the_gap_names_nothing() -> None:
    seen = verdict().model_copy(update={"seen": (Seen(name="armature"),)})
    assert causes(seen) == ()
    assert causes(verdict([said("armature")], "unknown_effect")) == ()


def test_an_effect_outside_the_library_is_one_that_no_name_fits() -> None:
    assert is_outside(outcome([fault()]))
    assert is_outside(outcome([COULOMB], without=["coulomb_friction"]))
    assert not is_outside(outcome([COULOMB]))
    assert not is_outside(outcome())


def test_joints_are_those_of_causes_and_of_what_is_unknown() -> None:
    everywhere = tuple(f"{leg}_{j}" for leg in ("fl", "fr", "hl", "hr") for j in ("hx", "hy", "kn"))
    both = outcome([COULOMB], [said("coulomb_friction"), said("payload_mass", joints=everywhere)])
    assert located(both) == set(KNEES)
    assert located(outcome([fault()], status="unknown_effect", unknown_joints=("fl_kn",))) == {"fl_kn"}
    assert f1({"fl_kn", "fl_hy"}, set(KNEES)) == pytest.approx(2 * 1 / (2 + 4))
    assert f1(set(), set(KNEES)) == 0.0


def test_parameters_are_measured_from_their_null() -> None:
    number = Number(value=0.84, low=0.79, high=0.89)
    (hit,) = parameters(outcome([GAIN], [said("torque_gain", parameters={"gain": number})]))
    assert (hit.error, hit.half_width) == (pytest.approx(0.2), pytest.approx(0.25))
    assert hit.is_covered
    assert not parameters(outcome([COULOMB], [said("torque_gain", parameters={"gain": number})]))


def test_claims_come_from_cases_with_a_clear_truth() -> None:
    stated = said("load_friction", "coulomb_friction", probability=0.7)
    o = outcome([COULOMB], [stated])
    assert claims(o) == [(0.7, True), (0.0, False), (0.0, False)]
    assert claims(outcome([COULOMB], [stated], moved=(0.1,))) == [(0.7, False), (0.0, True), (0.0, False)]
    assert claims(outcome([COULOMB], [stated], moved=(1.0,))) == []
    assert claims(outcome([fault()], status="unknown_effect"))[-1] == (0.0, True)


def test_the_table_counts_what_it_should() -> None:
    sure = said("armature", probability=0.95)
    some = [
        outcome([COULOMB], [said("coulomb_friction")], number=0, true_s=0.9),
        outcome([COULOMB], [said("armature")], number=1),
        outcome([COULOMB], number=2, moved=(0.3,)),
        outcome((), number=3, kind="faultless", error_scale=1.5),
        outcome((), [said("armature")], number=4, kind="faultless", error_scale=3.0),
        outcome((), [said("armature")], number=5, kind="faultless", error_scale=4.5),
        outcome([fault()], status="unknown_effect", number=6, kind="outside"),
        outcome([COULOMB, GAIN], [said("torque_gain")], number=7, kind="double"),
        outcome([COULOMB], [sure], number=8, kind="short", detail="import"),
        outcome([fault("power_limit", joints=())], [said("power_limit", joints=())], number=9, kind="sprint"),
        outcome([fault("armature")], [said("bus_sag", joints=())], number=10, kind="sprint"),
    ]
    rows = {r.key: r for r in table(some)}

    def counts(key: str) -> tuple[int, int]:
        value = rows[key].value
        return value.hits, value.trials  # type: ignore[union-attr]

    assert counts("faultless") == (1, 2)
    assert counts("faultless_4") == (0, 1)
    assert counts("one") == (2, 4)
    assert counts("two") == (0, 1)
    assert counts("two_one") == (1, 1)
    assert counts("outside") == (1, 1)
    assert counts("small") == (1, 1)
    assert counts("sure") == (0, 1)
    assert counts("power") == (1, 1)
    assert counts("power_blamed") == (1, 1)
    assert rows["true_s"].value.value == pytest.approx(0.9)
    assert breakdown(some)["kind"]["faultless"].trials == 3


def test_rounds_are_scored_by_themselves() -> None:
    after = Round(experiments=1, robot_s=20.0, verdict=verdict([said("coulomb_friction")]))
    o = outcome([COULOMB], rounds=[after])
    assert (is_right(o, 0), is_right(o, 1)) == (False, True)
    assert score(o, 1).named == {0}
    rows = {r.key: r for r in table([o])}
    assert rows["round_1"].value.value == 1.0
    assert rows["round_1_s"].value.value == pytest.approx(20.0)
