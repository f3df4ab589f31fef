"""Cases follow from seed and number alone, and hold the kinds in their proportions."""

from collections import Counter
from pathlib import Path

import pytest

from diagnosis.library.registry import LIBRARY
from spot_model.errors import BadInputError
from spot_model.policy.policy import load_policy
from withheld.cases.draw import LADDER, POWER_EFFECTS, RIVALS, SLOTS, Case, draw, kind_of
from withheld.cases.source import Source, source_of

POLICIES = Path("policies")
STAND_IN = source_of("tests.withheld.stand_in:StandIn")
N = sum(SLOTS.values())


@pytest.fixture(scope="module")
def cases() -> list[Case]:
    return [draw(11, n, STAND_IN, POLICIES) for n in range(N)]


def test_kinds_come_in_their_proportions(cases: list[Case]) -> None:
    assert Counter(c.kind for c in cases) == SLOTS
    assert [kind_of(11, n) for n in range(N)] != [kind_of(12, n) for n in range(N)]


def test_a_case_needs_no_other(cases: list[Case]) -> None:
    assert draw(11, 17, STAND_IN, POLICIES) == cases[17]
    assert draw(12, 17, STAND_IN, POLICIES) != cases[17]


def test_every_case_leaves_something_out_and_only_left_out_ones_the_truth(cases: list[Case]) -> None:
    for case in cases:
        true = {n for r in case.requests for n in STAND_IN.kinds[r.kind].names}
        assert case.without or case.kind in ("two", "three")
        assert (case.kind == "left_out") == bool(true & set(case.without))


def test_requests_fit_the_kind(cases: list[Case]) -> None:
    counts = {"none": 0, "two": 2, "three": 3}
    for case in cases:
        assert len(case.requests) == counts.get(case.kind, 1)
        assert all(r.size in LADDER and r.place in STAND_IN.kinds[r.kind].places for r in case.requests)
        if case.kind == "never":
            assert not STAND_IN.kinds[case.requests[0].kind].names


def test_a_robot_that_is_drawn_anew_walks_the_same_ways(cases: list[Case]) -> None:
    again = [draw(11, c.number, STAND_IN, POLICIES, attempt=1) for c in cases]
    for one, other in zip(cases, again, strict=True):
        for name in ("kind", "policy", "sequences", "repeats", "missing", "is_asked"):
            assert getattr(one, name) == getattr(other, name)
        assert one.reality_seed != other.reality_seed
    assert any(one.requests != other.requests for one, other in zip(cases, again, strict=True))


def test_a_quarter_asks_for_whole_logs_with_and_without_effects(cases: list[Case]) -> None:
    asked = [c for c in cases if c.is_asked]
    assert N / 8 < len(asked) < N / 2
    assert all(c.repeats == 5 and not c.missing and c.kind != "power" for c in asked)
    assert any(c.kind == "none" for c in asked)


def test_large_sizes_are_drawn_more_often() -> None:
    sizes = [r.size for n in range(4 * N) for r in draw(5, n, STAND_IN, POLICIES).requests]
    counts = Counter(sizes)
    assert set(counts) == set(LADDER)
    assert counts[1.0] > 2 * counts[0.2]


def test_commands_stay_in_the_policys_range(cases: list[Case]) -> None:
    contracts = {p.stem: load_policy(p).contract for p in POLICIES.glob("*.onnx")}
    assert {c.policy for c in cases} == set(contracts)
    for case in cases:
        contract = contracts[case.policy]
        for sequence in case.sequences:
            commands = sequence.sampled(50.0)
            assert (commands >= contract.velocity_command_low).all()
            assert (commands <= contract.velocity_command_high).all()


def test_the_power_table_runs_fast_with_its_rivals_in_the_library(cases: list[Case]) -> None:
    power = [c for c in cases if c.kind == "power"]
    for case in power:
        assert case.policy == "fast"
        assert max(s.sampled(50.0)[:, 0].max() for s in case.sequences) >= 4.0
        assert not RIVALS & set(case.without)


def test_signals_are_missing_in_some(cases: list[Case]) -> None:
    cut = [c for c in cases if c.missing]
    assert 0 < len(cut) < N / 3
    assert {c.repeats for c in cases} == {1, 2, 5}


def test_the_catalogue_gives_every_kind_of_case() -> None:
    source = source_of("")
    assert {n for k in source.kinds.values() for n in k.names} <= set(LIBRARY)
    made = [draw(3, n, source, POLICIES) for n in range(N)]
    assert Counter(c.kind for c in made) == SLOTS
    for case in made:
        assert set(case.without) <= set(LIBRARY)
        if case.kind == "power":
            assert set(source.kinds[case.requests[0].kind].names) & POWER_EFFECTS
        if case.kind == "never":
            assert not source.kinds[case.requests[0].kind].names


def test_without_policies_it_says_so(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="give --policies"):
        draw(1, 0, STAND_IN, tmp_path)


def test_a_users_reality_draws_its_own_faults() -> None:
    source = source_of("tests.withheld.stand_in:Alone")
    assert isinstance(source, Source)
    assert draw(1, 0, source, POLICIES).kind == "own"


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
