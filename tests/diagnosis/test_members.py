"""Members of a group in closed loops: who is run, who comes first, and what the odds become."""

from types import SimpleNamespace
from typing import Any

import pytest

from diagnosis.members import after_members, members_of, with_member
from diagnosis.posterior import Calibration, Group, Posterior
from diagnosis.selection.search import Rival, Selection

CALIBRATION = Calibration.load()


def _rival(*names: str) -> Rival:
    terms = tuple(SimpleNamespace(effect=SimpleNamespace(name=n)) for n in names)
    scored: Any = SimpleNamespace(terms=terms)
    return Rival(scored, 0.0)


DROP, JITTER, DELAY = (_rival("armature", n) for n in ("command_drop", "command_jitter", "command_delay"))
ROTOR = _rival("command_drop", "armature")
SELECTION = Selection(DROP.scored, (9.0, 5.0), ((ROTOR,), (DROP, JITTER, DELAY)), ())
GROUPS = (
    Group(("armature",), {"armature": 1.0}, 4.0),
    Group(("command_drop", "command_jitter"), {"command_drop": 0.6, "command_jitter": 0.4}, 4.0),
)


def test_every_other_member_of_a_group_is_run() -> None:
    assert [(m.effect, m.place) for m in members_of(SELECTION, GROUPS)] == [("command_jitter", 1)]
    assert members_of(Selection(None, (), (), ()), ()) == ()


def test_the_nearer_member_takes_the_place_and_comes_last() -> None:
    selection = Selection(ROTOR.scored, (5.0, 9.0), ((DROP, JITTER), (ROTOR,)), ())
    member = members_of(selection, (GROUPS[1], GROUPS[0]))[0]
    found = with_member(selection, member)
    assert found.best is JITTER.scored
    assert found.gains == (9.0, 5.0)
    assert found.rivals == ((ROTOR,), (JITTER, DROP))


@pytest.mark.parametrize(
    ("distance", "names"),
    [
        (1.5, ("command_jitter", "command_drop")),  # two floors nearer: in front
        (0.5, ("command_jitter",)),  # five: alone
    ],
)
def test_closed_loops_change_the_odds(distance: float, names: tuple[str, ...]) -> None:
    (member,) = members_of(SELECTION, GROUPS)
    told = type(member)(member.place, member.rival, distance, chosen_distance=3.5)
    if distance < 1.0:
        told = type(member)(member.place, member.rival, distance, chosen_distance=5.5)
    found = after_members(Posterior(0.0, 0.02, GROUPS), (told,), told, CALIBRATION)
    assert found.groups[0] is GROUPS[0]
    assert found.groups[1].names == names
    assert sum(found.groups[1].probabilities.values()) == pytest.approx(1.0)
    assert found.groups[1].probabilities["command_jitter"] > 0.8


def test_a_member_that_is_farther_off_leaves_the_group() -> None:
    (member,) = members_of(SELECTION, GROUPS)
    told = type(member)(member.place, member.rival, 6.0, chosen_distance=2.0)
    found = after_members(Posterior(0.0, 0.02, GROUPS), (told,), None, CALIBRATION)
    assert found.groups[1].names == ("command_drop",)
