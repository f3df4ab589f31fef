"""``--without`` and ``--add-effect``; and a person's path from an unknown effect to one of their own."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.channels import Channel
from diagnosis.channels.contact_events import ROWS as CONTACT_ROWS
from diagnosis.channels.dynamics import BASE_ROWS
from diagnosis.channels.kinematics import INERTIAL_ROWS
from diagnosis.channels.kinematics import ROWS as STANCE_ROWS
from diagnosis.channels.program import LINK_ROWS
from diagnosis.library import LibraryEffect
from diagnosis.library.registry import LIBRARY, chosen_library
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.scoring import null_of
from diagnosis.selection.search import search_effects
from diagnosis.verdict.left_over import left_over, probability
from diagnosis.verdict.unknown import describe_unknown
from spot_model.effects.base import Motion, TorqueEffect
from spot_model.errors import BadInputError

from .cases import drive_evidence

EXAMPLES = Path(__file__).parents[2] / "examples"
DOCUMENT = Path(__file__).parents[2] / "docs" / "diagnosis.md"


def test_left_out_effects_are_not_tried_and_twice_is_once() -> None:
    names = ["coulomb_friction", "torque_gain", "coulomb_friction"]
    assert set(chosen_library([], names)) == set(LIBRARY) - set(names)
    assert set(chosen_library([], [])) == set(LIBRARY)


@pytest.mark.parametrize(
    ("added", "without", "words"),
    [
        ([], ["friction"], r"--without 'friction' is not in the library; allowed: .*coulomb_friction"),
        ([], list(LIBRARY), "library is empty"),
        (["oil_drag"], [], r"--add-effect 'oil_drag'; allowed: module:Class"),
        (["no_such_module:Entry"], [], r"cannot be loaded: No module named 'no_such_module'; is it on the Python path"),
        (["half_done:nothing"], [], r"is no Effect of spot_model.effects.base, and no LibraryEffect"),
        (["oil_drag:OilDrag", "oil_drag:OilDrag"], [], r"is named 'oil_drag', as one of the library is"),
        (["half_done:Bare"], [], r"lacks the attribute effect; write it"),
        (["half_done:Wide"], [], r"wide.at_rad cannot be searched from -1e\+09 to 1e\+09; bound it closer"),
        (["half_done:Empty"], [], r"effect empty has no parameter to fit"),
        (["spot_model.effects.bodies:LegMass"], [], r"leg_mass changes no torque between set-point and load"),
    ],
)
def test_what_cannot_be_done_is_said(
    added: list[str], without: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "half_done.py").write_text(
        "from dataclasses import dataclass\n"
        "from typing import Any\n"
        "from diagnosis.library import LibraryEffect\n"
        "from spot_model.effects.base import TorqueEffect, parameter\n"
        "nothing = 3\n"
        "class Bare(LibraryEffect):\n    name = 'bare'\n"
        "class Empty(TorqueEffect):\n    name = 'empty'\n"
        "    def torque(self, torque_nm, motion, memory): return torque_nm, memory\n"
        "@dataclass(frozen=True, kw_only=True)\n"
        "class Wide(Empty):\n    name = 'wide'\n"
        "    at_rad: Any = parameter(null=0.0, low=-1e9, high=1e9, unit='rad', source='')\n"
    )
    with pytest.raises(BadInputError, match=re.compile(words, re.DOTALL)):
        chosen_library(added, without)


class _Drag(TorqueEffect):
    """The hidden truth, in other words than the example's."""

    name = "planted_drag"

    def torque(self, torque_nm, motion: Motion, memory):
        speed = motion.velocity_rad_s
        return torque_nm - 0.25 * np.sign(speed) * speed**2 * self.mask, memory

    @property
    def is_null(self) -> bool:
        return False


@pytest.fixture(scope="module")
def logs() -> Evidence:
    return drive_evidence(_Drag(joints=("fr_kn",)))[1]


def _found(board: Evidence, library: dict[str, LibraryEffect]) -> dict[str, tuple[tuple[str, ...], dict[str, float]]]:
    best = search_effects(board, library, lambda _: None).best
    terms = zip(best.terms, best.coefficients, strict=True)
    return {
        t.effect.name: (board.robot.named(board.robot.joints_of(t.effect, t.place)), dict(t.effect.values(c, t.shape)))
        for t, c in terms
    }


def test_the_effect_that_a_person_writes_explains_what_the_library_cannot(
    logs: Evidence, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))
    names = ("coulomb_friction", "viscous_friction", "torque_gain", "armature")
    small = {name: LIBRARY[name] for name in names}
    added = chosen_library(["oil_drag:OilDrag"], [])["oil_drag"]
    found = _found(logs, {**small, "oil_drag": added})
    joints, values = found["oil_drag"]
    assert joints == ("fr_kn",)
    assert values["drag"] == pytest.approx(0.25, rel=0.2)
    assert "oil_drag" not in _found(logs, small)


def test_what_is_left_points_at_the_joint_and_its_speed(logs: Evidence) -> None:
    nothing = null_of(logs)
    left = left_over(logs, nothing)
    unknown = describe_unknown(logs, nothing, left)
    assert unknown is not None
    assert (unknown.channel, unknown.joints) == (Channel.SET_POINT_TO_LOAD, ("fr_kn",))
    # A knee that swings is fast and bears nothing.
    assert unknown.regime in ("high speed", "low torque")
    assert unknown.left > 2.0 * unknown.usual
    assert probability(left) > 0.5


@pytest.mark.parametrize(
    ("rows", "unit", "told"),
    [
        (BASE_ROWS, "N, N·m", {"force_z": "N", "moment_x": "N·m"}),
        (STANCE_ROWS, "m/s, m", {"fl_velocity_x": "m/s", "hr_height": "m"}),
        (CONTACT_ROWS, "s, 1, s", {"fl_flag": "s", "fr_slip": "1", "hl_stop": "s"}),
        (INERTIAL_ROWS, "m/s², rad/s", {"acceleration_y": "m/s²", "turn_z": "rad/s"}),
        (LINK_ROWS, "s, s, 1", {"delay": "s", "spread": "s", "lost": "1"}),
    ],
)
def test_a_row_has_its_own_unit(logs: Evidence, rows: tuple[str, ...], unit: str, told: dict[str, str]) -> None:
    view = replace(logs.views[Channel.SET_POINT_TO_LOAD], rows=rows, unit=unit)
    assert {name: view.unit_of(rows.index(name)) for name in told} == told


def test_the_document_shows_the_example_as_it_is() -> None:
    assert (EXAMPLES / "oil_drag.py").read_text() in DOCUMENT.read_text()
