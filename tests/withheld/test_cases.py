"""Cases follow from seed and number alone, and hold the kinds in their proportions."""

from collections import Counter
from pathlib import Path

import pytest

from spot_model.effects.registry import BUILT_IN
from spot_model.errors import BadInputError
from spot_model.policy.policy import load_policy
from withheld.cases import BLOCK, SIZES, SLOTS, SPRINT_KINDS, WHOLE_RUN, Case, chosen, draw, kind_of
from withheld.realities.source import source_of

POLICIES = Path("policies")
JUDGING = source_of("judging")
N = BLOCK


@pytest.fixture(scope="module")
def cases() -> list[Case]:
    return [draw(11, n, JUDGING, POLICIES) for n in range(N)]


def test_a_whole_run_has_the_cases_that_are_asked_for() -> None:
    whole = {kind: 10 * count for kind, count in SLOTS.items()}
    assert whole["single"] + whole["sprint"] >= 300
    assert whole["double"] >= 150
    assert whole["faultless"] >= 150
    assert whole["outside"] + whole["left_out"] >= 150
    assert SIZES == (0.3, 1.0)
    assert sum(whole.values()) == WHOLE_RUN


def test_kinds_come_in_their_proportions(cases: list[Case]) -> None:
    assert Counter(c.kind for c in cases) == SLOTS
    assert [kind_of(11, n) for n in range(N)] != [kind_of(12, n) for n in range(N)]


def test_a_case_needs_no_other(cases: list[Case]) -> None:
    assert draw(11, 17, JUDGING, POLICIES) == cases[17]
    assert draw(12, 17, JUDGING, POLICIES) != cases[17]


def test_every_case_leaves_something_out_and_only_left_out_ones_the_truth(cases: list[Case]) -> None:
    for case in cases:
        true = {n for r in case.requests for n in JUDGING.kinds[r.kind].names}
        assert case.without
        assert set(case.without) <= set(BUILT_IN)
        assert (case.kind == "left_out") == bool(true & set(case.without))


def test_requests_fit_the_kind(cases: list[Case]) -> None:
    for case in cases:
        kinds = [JUDGING.kinds[r.kind] for r in case.requests]
        assert all(r.place in k.places for r, k in zip(case.requests, kinds, strict=True))
        if case.kind in ("single", "double", "left_out", "sprint"):
            assert len(kinds) == (2 if case.kind == "double" else 1)
            assert all(k.names for k in kinds)
        if case.kind == "outside":
            assert not kinds[0].names
        if case.kind == "faultless":
            assert not kinds


def test_a_sprint_is_fast_and_keeps_all_rivals_in_the_library(cases: list[Case]) -> None:
    rivals = {n for k in SPRINT_KINDS for n in JUDGING.kinds[k].names}
    for case in (c for c in cases if c.kind == "sprint"):
        assert max(s.sampled(50.0)[:, 0].max() for s in case.sequences) >= 4.0
        assert not rivals & set(case.without)


def test_a_short_case_is_one_run_as_a_foreign_recording_has_it(cases: list[Case]) -> None:
    for case in (c for c in cases if c.kind == "short"):
        assert (len(case.sequences), case.repeats, case.detail) == (1, 1, "import")
        assert {"receipts", "battery", "contact"} <= set(case.missing)


def test_a_robot_that_is_drawn_anew_walks_the_same_ways(cases: list[Case]) -> None:
    for one in cases[:20]:
        other = draw(11, one.number, JUDGING, POLICIES, attempt=1)
        for name in ("kind", "policy", "sequences", "repeats", "missing", "detail"):
            assert getattr(one, name) == getattr(other, name)
        assert one.reality_seed != other.reality_seed


def test_commands_stay_in_the_policys_range(cases: list[Case]) -> None:
    contracts = {p.stem: load_policy(p).contract for p in POLICIES.glob("*.onnx")}
    for case in cases:
        contract = contracts[case.policy]
        for sequence in case.sequences:
            commands = sequence.sampled(50.0)
            assert (commands >= contract.velocity_command_low).all()
            assert (commands <= contract.velocity_command_high).all()


def test_cases_are_chosen_kind_by_kind() -> None:
    numbers = chosen(11, range(N), ["faultless", "double"])
    kinds = [kind_of(11, n) for n in numbers]
    assert kinds == ["faultless"] * 15 + ["double"] * 15
    assert chosen(11, range(3), ()) == [0, 1, 2]
    with pytest.raises(BadInputError, match="kind 'none' is unknown; allowed: faultless"):
        chosen(11, range(3), ["none"])


def test_without_policies_it_says_so(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="give --policies"):
        draw(1, 0, JUDGING, tmp_path)


def test_a_users_reality_draws_its_own_faults() -> None:
    assert draw(1, 0, source_of("tests.withheld.stand_in:Alone"), POLICIES).kind == "own"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("nowhere", "module:Class"),
        ("tests.withheld.stand_in:Absent", "cannot be loaded"),
        ("json:loads", "lacks record"),
    ],
)
def test_a_reality_that_is_none_is_refused(name: str, text: str) -> None:
    with pytest.raises(BadInputError, match=text):
        source_of(name)
