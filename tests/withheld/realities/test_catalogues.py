"""Laws of both catalogues, and the wall between them."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import diagnosis
import withheld
from spot_model.effects.registry import BUILT_IN
from spot_model.robot.facts import JOINT_NAMES
from tests.withheld.simulator.quick import brief
from withheld.plan import FaultRequest
from withheld.realities.fault_kind import FaultKind
from withheld.realities.reality import make
from withheld.realities.source import CATALOGUES

ROOT = Path(withheld.__file__).parent
CALIBRATING, JUDGING = (ROOT / "realities" / name for name in ("calibrating", "judging"))
EVERY = [
    pytest.param(kind, id=f"{name}-{kind.name}")
    for name, catalogue in CATALOGUES.items()
    for kind in catalogue.values()
]
SIGNALS = ("load_nm", "position_rad", "velocity_rad_s", "foot_contact", "odom_from_body_wxyz", "battery_v")
RARE = ("motor_drop_outs", "power_budget", "bus_current_limiter")
"""Half a second of a slow walk may pass without one, or draw too little power for it."""
FORMULA = 600
"""Characters of a syntax tree; a shorter one is an assignment and no formula."""


def imports(folder: Path) -> Iterator[str]:
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module:
                yield node.module
            elif isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names)


def formulas(folder: Path) -> dict[str, str]:
    """Every function's body without constants and names of variables: what is left is the formula."""
    found = {}
    for path in folder.glob("*.py"):
        for function in ast.walk(ast.parse(path.read_text())):
            if not isinstance(function, ast.FunctionDef):
                continue
            body = [s for s in function.body if not isinstance(s, ast.Expr)]
            for node in (n for s in body for n in ast.walk(s)):
                if isinstance(node, ast.Constant):
                    node.value = 0
                elif isinstance(node, ast.Name):
                    node.id = "x"
            found[f"{path.stem}.{function.name}"] = "".join(ast.dump(s) for s in body)
    return found


def test_the_catalogues_share_nothing_but_the_simulator() -> None:
    for folder, other in ((CALIBRATING, "judging"), (JUDGING, "calibrating")):
        own = {m for m in imports(folder) if m.startswith("withheld")}
        allowed = ("withheld.simulator", "withheld.realities.fault_kind", f"withheld.realities.{folder.name}")
        assert {m for m in own if not m.startswith(allowed)} == set()
        assert not any(other in m for m in own)


def test_the_catalogues_share_no_formula_and_no_name() -> None:
    one, other = formulas(CALIBRATING), formulas(JUDGING)
    same = {(a, b) for a, x in one.items() for b, y in other.items() if x == y and len(x) > FORMULA}
    assert same == set()
    assert not set(CATALOGUES["calibrating"]) & set(CATALOGUES["judging"])


def test_the_diagnosis_imports_neither() -> None:
    assert not {m for m in imports(Path(diagnosis.__file__).parent) if m.startswith("withheld")}


def test_judging_kinds_cover_the_library_and_what_is_outside_of_it() -> None:
    kinds = CATALOGUES["judging"].values()
    # Every robot's load cells lag and its estimator believes its feet; delay and offset of the torque have no kind yet.
    # Slopes and grass are judged by lab/benchmarks/ground.py. An arm is no fault: the robot says whether it has one.
    ordinary = {"load_filter", "leg_odometry", "stowed_arm"}
    missing = {"torque_delay", "torque_offset", "ground_slope", "foot_drag"}
    assert set(BUILT_IN) - {n for kind in kinds for n in kind.names} == ordinary | missing
    assert sum(not kind.names for kind in kinds) >= 9


@pytest.mark.parametrize("kind", EVERY)
def test_a_fault_changes_the_log_and_breaks_no_number(kind: FaultKind) -> None:
    run, same = brief(kind), brief()
    assert np.isfinite(run.load_nm).all()
    assert np.isfinite(run.position_rad).all()
    if kind.name in RARE:
        return
    assert [n for n in SIGNALS if not np.array_equal(getattr(run, n), getattr(same, n))]


@pytest.mark.parametrize("kind", EVERY)
def test_the_truth_uses_the_librarys_words(kind: FaultKind) -> None:
    assert set(kind.names) <= set(BUILT_IN)
    for place in kind.places:
        for seed in range(3):
            request = FaultRequest(kind=kind.name, place=place, size=0.5)
            (fault,) = make([request], seed, {kind.name: kind}).truth.faults
            assert set(fault.joints) <= set(JOINT_NAMES)
            assert (fault.joints == ()) == (place == "body")
            for parameter in fault.parameters:
                effect, value = parameter.split(".")
                assert effect in kind.names
                assert value in {p.name for p in BUILT_IN[effect].parameters()}


def test_an_unknown_fault_and_a_wrong_place_are_refused() -> None:
    judging = CATALOGUES["judging"]
    with pytest.raises(ValueError, match=r"fault 'rust' is unknown; allowed: amplifier_gain"):
        make([FaultRequest(kind="rust", place="joint", size=1.0)], 0, judging)
    with pytest.raises(ValueError, match=r"lead cannot act at place 'joint'; allowed: body"):
        make([FaultRequest(kind="lead", place="joint", size=1.0)], 0, judging)
