"""What is right and what is wrong, case by case, worked out by hand."""

import pytest

from diagnosis.verdict import Number
from withheld.scoring.outcome import Answer, Said
from withheld.scoring.scores import f1, is_foreign, is_full, is_large, parameters, score, score_answer, stated
from withheld.scoring.table import breakdown, comparison, confusion, power_answer, power_curve, tables

from .made_up import KNEES, fault, outcome, said

COULOMB = fault("coulomb_friction", coulomb_friction__level_nm=2.0)


def test_named_first_is_right_in_every_way() -> None:
    s = score(outcome([COULOMB], [said("coulomb_friction")]))
    assert (s.top1, s.group, s.joint_f1, s.missed) == (True, True, 1.0, False)


def test_a_member_of_the_group_is_right_but_not_first() -> None:
    s = score(outcome([COULOMB], [said("load_friction", "coulomb_friction", "stribeck_friction")]))
    assert (s.top1, s.group) == (False, True)


def test_a_group_of_four_says_nothing() -> None:
    s = score(outcome([COULOMB], [said("a", "b", "c", "coulomb_friction")]))
    assert (s.top1, s.group) == (False, False)


def test_one_effect_too_many_is_wrong() -> None:
    s = score(outcome([COULOMB], [said("coulomb_friction"), said("armature")]))
    assert (s.top1, s.group) == (False, False)


def test_the_first_that_is_listed_counts_beside_whatever_the_status_and_the_others() -> None:
    right, wrong = said("coulomb_friction"), said("armature")
    assert score(outcome([COULOMB], [right, wrong])).first is True
    assert score(outcome([COULOMB], [wrong, right])).first is False
    unsure = score(outcome([COULOMB], [right], "unknown_effect"))
    assert (unsure.first, unsure.top1, unsure.group) == (True, False, False)
    assert score(outcome([COULOMB], [said("a", "b", "coulomb_friction")])).first is True
    assert score(outcome([COULOMB], [said("a", "b", "c", "coulomb_friction")])).first is False
    assert score(outcome([COULOMB])).first is False
    assert score(outcome([COULOMB, fault("armature")], [right])).first is None


def test_what_is_said_of_a_hidden_limit_of_power() -> None:
    hidden = [fault("bus_sag", "torque_speed_curve", joints=())]

    def answer(*effects: Said, status: str = "") -> str:
        return power_answer(outcome(hidden, effects, status, kind="power"))

    told = said("torque_speed_curve", "bus_sag").model_copy(update={"split_by": "run faster"})
    assert answer(said("bus_sag")) == "named"
    assert answer(told) == "told"
    assert answer(said("torque_speed_curve", "bus_sag")) == "listed"
    assert answer(said("bus_sag"), status="unknown_effect") == "listed"
    assert answer(said("armature")) == "rival"
    assert answer(said("torque_speed_curve")) == "other"
    assert answer() == "other"


def test_joints_are_scored_by_f1() -> None:
    s = score(outcome([COULOMB], [said("coulomb_friction", joints=("fl_kn", "fl_hy"))]))
    assert s.joint_f1 == pytest.approx(2 * 1 / (2 + 4))
    assert f1(set(), set(KNEES)) == 0.0


def test_an_effect_of_the_whole_robot_names_no_joints() -> None:
    everywhere = tuple(f"{leg}_{j}" for leg in ("fl", "fr", "hl", "hr") for j in ("hx", "hy", "kn"))
    both = [COULOMB, fault("payload_mass", joints=())]
    s = score(outcome(both, [said("coulomb_friction"), said("payload_mass", joints=everywhere)]))
    assert s.joint_f1 == 1.0


def test_no_effect() -> None:
    assert score(outcome()).false_alarm is False
    assert score(outcome((), [said("armature")])).false_alarm is True
    assert score(outcome((), status="unknown_effect")).false_alarm is True
    assert score(outcome((), status="cannot_tell")).false_alarm is False


def test_an_effect_that_is_not_there_has_to_be_called_unknown() -> None:
    for case in (outcome([fault()], status="unknown_effect", unknown_joints=("fl_kn",)),
                 outcome([COULOMB], status="unknown_effect", unknown_joints=("fl_kn",), kind="left_out",
                         without=["coulomb_friction"])):
        assert is_foreign(case)
        s = score(case)
        assert (s.unknown, s.unknown_joints, s.top1) == (True, True, None)
    assert score(outcome([fault()], [said("armature")])).unknown is False
    assert score(outcome([fault()], status="unknown_effect", unknown_joints=("fl_hx",))).unknown_joints is False


def test_two_at_once_want_both() -> None:
    pair = [COULOMB, fault("torque_gain", joints=("fl_hy",))]
    assert score(outcome(pair, [said("torque_gain"), said("coulomb_friction")])).found == 2
    one = score(outcome(pair, [said("torque_gain")]))
    assert (one.found, one.group) == (1, False)


def test_a_failed_diagnosis_is_wrong_but_no_alarm() -> None:
    assert score(outcome([COULOMB], status="failed")).group is False
    assert score(outcome((), status="failed")).false_alarm is False


def test_parameters_are_measured_from_their_null() -> None:
    gain = fault("torque_gain", torque_gain__gain=0.8)
    number = Number(value=0.84, low=0.79, high=0.88)
    (hit,) = parameters(outcome([gain], [said("torque_gain", parameters={"gain": number})]))
    assert hit.error == pytest.approx(0.2)
    assert hit.covered
    assert not parameters(outcome([COULOMB], [said("torque_gain", parameters={"gain": number})]))


def test_baselines_answer_with_one_effect_and_never_with_unknown() -> None:
    right = Answer(has_gap=True, effect="coulomb_friction", joints=KNEES)
    assert score_answer(outcome([COULOMB]), right).group is True
    assert score_answer(outcome([COULOMB]), right.model_copy(update={"has_gap": False})).group is False
    assert score_answer(outcome(), right).false_alarm is True
    assert score_answer(outcome([fault()]), right).unknown is False


def test_large_and_full() -> None:
    assert is_large(outcome([COULOMB], moved=2.0))
    assert not is_large(outcome([COULOMB], moved=1.9))
    assert not is_large(outcome([COULOMB]))
    assert is_full(outcome())
    assert not is_full(outcome(repeats=2))


def test_claims_of_a_verdict() -> None:
    made = stated([outcome([COULOMB], [said("coulomb_friction", probability=0.7)], probability_none=0.1)])
    assert made.said == [0.1, 0.0, 0.7]
    assert made.true == [False, False, True]


def test_the_table_counts_what_it_should() -> None:
    some = [
        outcome([COULOMB], [said("coulomb_friction")], moved=3.0, number=0, s=0.9),
        outcome([COULOMB], [said("armature")], moved=3.0, number=1),
        outcome([COULOMB], number=2, moved=0.3),
        outcome((), number=3, kind="none"),
        outcome((), [said("armature")], number=4, kind="none"),
        outcome([fault()], status="unknown_effect", number=5, kind="never", moved=5.0),
        outcome([fault("power_limit")], [said("power_limit")], number=6, kind="power", moved=9.0),
    ]
    made = tables(some)
    rows = {name: {r.key: r for r in t.rows} for name, t in made.items()}
    assert (rows["all"]["group"].value.hits, rows["all"]["group"].value.trials) == (2, 4)
    assert (rows["issue"]["group"].value.hits, rows["issue"]["group"].value.trials) == (1, 2)
    assert rows["issue"]["group"].is_met is False
    assert (rows["power"]["group"].value.hits, rows["power"]["group"].value.trials) == (1, 1)
    assert rows["power"]["power_answered"].is_met is True
    assert (rows["all"]["false_alarm"].value.hits, rows["all"]["false_alarm"].value.trials) == (1, 2)
    assert rows["all"]["unknown"].value.value == 1.0
    assert rows["all"]["s"].value.value == pytest.approx(0.9)
    assert rows["all"]["s_coverage"].value.value == 1.0
    assert confusion(some)["coulomb_friction"] == {"coulomb_friction": 1, "armature": 1, "none": 1}
    ((size, named, noticed),) = power_curve(some)
    assert (size, named.hits, noticed.hits, named.trials) == (0.6, 2, 3, 4)
    assert breakdown(some)["repeats"]["5"].trials == 4
    assert comparison(some)["false_alarm"]["diagnosis"]["hits"] == 1
    assert comparison(some)["group"]["two_sample"] is None


def test_an_answer_with_a_figure_that_there_is_none_of_can_be_read_again() -> None:
    """A classifier's p-value of too few runs, say: one such case must not make a whole run unreadable."""
    answer = Answer(has_gap=False, detail={"p_value": float("nan"), "change": 0.5})
    assert answer.detail == {"p_value": None, "change": 0.5}
    assert Answer.model_validate_json(answer.model_dump_json()) == answer
