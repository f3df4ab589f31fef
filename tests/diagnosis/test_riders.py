"""Effects in doubt: which they are, and what closed loops decide."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis import measure, riders
from diagnosis.riders import Rider, riders_of, turned
from diagnosis.selection import search
from diagnosis.selection.search import Rival, Selection
from diagnosis.shrink import Compared


def _scored(*names: str, confused_with: tuple[str, ...] = ()) -> Any:
    terms = tuple(SimpleNamespace(effect=SimpleNamespace(name=n, confused_with=confused_with)) for n in names)
    return SimpleNamespace(terms=terms)


BOTH = _scored("armature", "contact_delay")
MORE = [
    Rival(_scored("armature", "contact_delay", n), 9.0) for n in ("imu_tilt", "leg_mass", "foot_radius", "backlash")
]


@pytest.fixture(autouse=True)
def _no_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(riders, "Scorer", lambda _, terms: SimpleNamespace(now=SimpleNamespace(terms=terms)))


def _selection(gains: tuple[float, ...], doubtful: tuple[Rival, ...] = ()) -> Selection:
    return Selection(BOTH, gains, ((), ()), (), doubtful)


def test_a_weak_effect_beside_a_strong_one_is_in_doubt() -> None:
    board: Any = None
    (rider,) = riders_of(_selection((80.0, 9.0)), board)
    assert (rider.effect, rider.is_added) == ("contact_delay", False)
    assert [t.effect.name for t in rider.scored.terms] == ["armature"]
    assert riders_of(_selection((80.0, 13.0)), board) == ()
    assert riders_of(Selection(None, (), (), ()), board) == ()


def test_the_strongest_effect_is_never_in_doubt() -> None:
    board: Any = None
    alone = Selection(_scored("armature"), (7.0,), ((),), ())
    assert riders_of(alone, board) == ()
    assert [r.effect for r in riders_of(_selection((8.0, 9.0)), board)] == ["armature"]


def test_three_effects_that_were_not_chosen_are_tried() -> None:
    board: Any = None
    found = riders_of(_selection((80.0, 70.0), tuple(MORE)), board)
    assert [(r.effect, r.is_added) for r in found] == [("imu_tilt", True), ("leg_mass", True), ("foot_radius", True)]


def _rider(name: str, *, is_added: bool) -> Rider:
    return Rider(name, _scored(name), is_added)


@pytest.mark.parametrize(
    ("is_added", "distance", "turns"),
    [
        (True, 1.6, True),  # with it nearer by 0.4 floors: added
        (True, 1.8, False),
        (True, 2.5, False),
        (False, 1.9, True),  # without it nearer: left out
        (False, 2.1, False),  # without it hardly farther, but so: it stays
    ],
)
def test_closed_loops_decide(is_added: bool, distance: float, turns: bool) -> None:
    rider = _rider("leg_mass", is_added=is_added)
    found = turned((rider,), {"corrected": 2.0, rider.name: distance}, clearly=0.3)
    assert (found is rider) == turns


def test_one_change_at_a_time_the_clearest() -> None:
    first, second = _rider("leg_mass", is_added=True), _rider("imu_tilt", is_added=False)
    distances = {"corrected": 3.0, first.name: 2.0, second.name: 2.5}
    assert turned((first, second), distances, clearly=0.3) is first
    assert turned((), distances, clearly=0.3) is None


def test_doubtful_is_what_adds_enough_and_is_not_mistaken_for_a_term() -> None:
    terms: Any = _scored("armature", confused_with=("torque_bandwidth",)).terms
    candidates = [
        Rival(_scored("armature", name), value)
        for name, value in (("torque_bandwidth", 140.0), ("coulomb_friction", 121.0), ("leg_mass", 104.0))
    ]
    found = search._doubtful(terms, candidates, 100.0, 6.0)
    assert [r.scored.terms[-1].effect.name for r in found] == ["coulomb_friction"]


def _decided(monkeypatch: pytest.MonkeyPatch, distances: dict[str, float], *, repeats: int = 2) -> Any:
    real = np.ones((repeats, repeats))
    models = {name: np.full((2, repeats), d) for name, d in distances.items()}
    monkeypatch.setattr(measure, "_compared", lambda *_: ([Compared("a", real, models)], []))
    bench: Any = None
    riders_ = (_rider("leg_mass", is_added=True),)
    runs: dict[str, list[Any]] = {name: [name] for name in distances}
    return measure.decided(bench, measure.Simulated(runs, "", (), riders_, True, ()))


def test_the_model_that_won_takes_the_place_of_the_corrected_one(monkeypatch: pytest.MonkeyPatch) -> None:
    simulated, winner, rider = _decided(monkeypatch, {"nominal": 4.0, "corrected": 3.0, "with leg_mass": 2.0})
    assert (winner, rider.effect) == (None, "leg_mass")
    assert simulated.runs == {"nominal": ["nominal"], "corrected": ["with leg_mass"]}


def test_what_does_not_bring_closed_loops_nearer_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    simulated, _, rider = _decided(monkeypatch, {"nominal": 4.0, "corrected": 3.0, "with leg_mass": 2.9})
    assert rider is None
    assert simulated.runs == {"nominal": ["nominal"], "corrected": ["corrected"]}


def test_without_repeats_closed_loops_decide_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    simulated, _, rider = _decided(
        monkeypatch, {"nominal": 4.0, "corrected": 3.0, "with leg_mass": 1.0}, repeats=1
    )  # fmt: skip
    assert rider is None
    assert simulated.riders == ()
    assert set(simulated.runs) == {"nominal", "corrected"}
