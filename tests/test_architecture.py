"""The house as ARCHITECTURE.md draws it: folders that one can take in at a glance, arrows without a circle."""

from __future__ import annotations

import ast
import runpy
import subprocess
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = (
    "spot_model",
    "spot_log",
    "spot_runtime",
    "spot_tools",
    "spot_rl",
    "fake_robot",
    "trainer",
    "diagnosis",
    "compare",
    "proof",
    "withheld",
)
LAB = ROOT / "lab"
MOST_ENTRIES = 14
NO_ENTRIES = {"__init__.py", "__main__.py", "py.typed"}


def home(package: str) -> Path:
    """Folder in which a package lies."""
    return LAB if (LAB / package).is_dir() else ROOT


@cache
def sources(package: str) -> tuple[Path, ...]:
    at = home(package)
    listed = subprocess.run(["git", "ls-files", package], cwd=at, capture_output=True, text=True, check=True)
    return tuple(at / line for line in listed.stdout.split("\n") if line.endswith(".py") and (at / line).exists())


def modules_imported(source: str) -> Iterator[str]:
    """Every module that a file imports, also within functions."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def room(package: str, module: str) -> str | None:
    """The sub-package of a module, or the module itself where it lies at the package's root."""
    parts = module.split(".")
    if parts[0] != package or len(parts) < 2:
        return None
    inside = home(package) / package / parts[1]
    return parts[1] if inside.is_dir() or inside.with_suffix(".py").exists() else None


def arrows(package: str) -> dict[str, set[str]]:
    found: dict[str, set[str]] = {}
    for path in sources(package):
        parts = path.relative_to(home(package)).with_suffix("").parts
        if len(parts) < 2 or parts[1] in {"__init__", "__main__"}:
            continue
        to = {room(package, module) for module in modules_imported(path.read_text(encoding="utf-8"))}
        found.setdefault(parts[1], set()).update(name for name in to if name and name != parts[1])
    return found


def circle(graph: dict[str, set[str]]) -> list[str]:
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


@pytest.mark.parametrize("package", PACKAGES)
def test_arrows_between_sub_packages_have_no_circle(package: str) -> None:
    assert circle(arrows(package)) == []


def test_a_circle_would_be_found() -> None:
    assert set(circle({"a": {"b"}, "b": {"c"}, "c": {"a"}})) == {"a", "b", "c"}
    assert circle({"a": {"b", "c"}, "b": {"c"}}) == []
    assert set(modules_imported("def f():\n    from a.b import c\nimport d.e")) == {"a.b", "a.b.c", "d.e"}


@pytest.mark.parametrize("package", PACKAGES)
def test_no_folder_has_more_entries_than_one_takes_in_at_a_glance(package: str) -> None:
    entries: dict[str, set[str]] = {}
    for path in sources(package):
        below = path.relative_to(home(package))
        for parent in list(below.parents)[:-1]:
            entries.setdefault(str(parent), set()).add(below.relative_to(parent).parts[0])
    crowded = {folder: len(names - NO_ENTRIES) for folder, names in entries.items()}
    assert {folder: n for folder, n in crowded.items() if n > MOST_ENTRIES} == {}


# To change X, open Y --------------------------------------------------------------------------------------------------

EFFECT = '''
from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import ModelEffect, ModelFields, parameter


@dataclass(frozen=True, kw_only=True)
class Drag(ModelEffect):
    """Thrown away."""

    name: ClassVar[str] = "thrown_away"
    drag_nm_s_per_rad: Any = parameter(null=0.0, low=0.0, high=5.0, unit="N·m·s/rad", source="made up")

    def edit(self, fields: ModelFields) -> None:
        fields["dof_damping"][:, fields.joint_dofs] += self.drag_nm_s_per_rad * self.mask
'''


def naming(text: str, *packages: str) -> set[str]:
    """Files of the product, without tests and generated code, that hold a text."""
    return {
        str(path.relative_to(ROOT))
        for package in packages
        for path in sources(package)
        if text in path.read_text(encoding="utf-8")
    }


def test_an_effect_is_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import importlib

    from spot_model.effects.registry import BUILT_IN, effects_in

    room = tmp_path / "thrown_away_effects" / "drive"
    room.mkdir(parents=True)
    (room.parent / "__init__.py").touch()
    (room / "__init__.py").touch()
    (room / "drag.py").write_text(EFFECT)
    monkeypatch.syspath_prepend(str(tmp_path))
    package = importlib.import_module("thrown_away_effects")  # noqa: TID251 - a package that exists in this test alone
    assert list(effects_in(package)) == ["thrown_away"]
    # And none of ours is named anywhere as one of a list.
    for name in ("TorqueRipple", "ContactDelay", "JointSwap"):
        assert len(naming(name, "spot_model", "spot_log", "spot_runtime", "fake_robot", "trainer")) == 1
    assert {"torque_ripple", "contact_delay", "joint_swap"} <= set(BUILT_IN)


def test_a_field_of_the_observation_is_at_most_four_files() -> None:
    from spot_model.policy.observation import OBSERVATION

    where_it_is_built = naming("build_observation(", "spot_model", "spot_log", "spot_runtime", "fake_robot", "trainer")
    noise = naming("class NoiseConfig(", "trainer")
    assert where_it_is_built | noise == {
        "spot_model/policy/observation.py",
        "spot_model/policy/policy.py",
        "trainer/task/task.py",
        "trainer/config/task_config.py",
    }
    for field in (field for field in OBSERVATION if field.noise):
        assert len(naming(f'"{field.name}"', "spot_model", "spot_log", "spot_runtime", "trainer")) <= 4


def test_a_field_of_the_tick_is_at_most_four_files() -> None:
    from dataclasses import fields

    from spot_log.format.records import TickRecord
    from spot_log.format.tables import TickTable
    from spot_protos import log_pb2

    # The four: the message, the record, the table, and who fills the record.
    names = set(TickTable.columns())
    assert names == {field.name for field in fields(TickRecord)} == set(log_pb2.Tick.DESCRIPTOR.fields_by_name)
    # What carries ticks from the loop to a table names none of them.
    carriers = ("write/hand_off.py", "read/columns.py", "read/reader.py", "format/codec.py")
    own = ("inference_s", "compute_s", "state_age_s", "skipped", "command_key", "velocity_command")
    for carrier in carriers:
        text = (ROOT / "spot_log" / carrier).read_text(encoding="utf-8")
        assert [name for name in own if name in text] == []


def test_a_reward_is_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("torch")
    from trainer.config.task_config import RewardWeights
    from trainer.task.rewards import reward_term

    (tmp_path / "thrown_away_rewards.py").write_text("def calm(moment, shape):\n    return 1.0\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    weights = RewardWeights.model_validate({"thrown_away_rewards:calm": 2.0}).by_name()
    assert reward_term(list(weights)[-1])(None, None) == 1.0


def test_a_figure_of_the_page_is_one_file(monkeypatch: pytest.MonkeyPatch) -> None:
    from spot_log.page import figures

    monkeypatch.setattr(figures, "FIGURES", dict(figures.FIGURES))

    @figures.figure("Thrown away", "One function.")
    def thrown_away(run: object) -> None:
        return None

    assert list(figures.FIGURES)[-1] == "thrown_away"
    assert naming("def contacts(", "spot_log") == {"spot_log/page/figures.py"}


def test_a_fault_is_one_file(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco")
    from fake_robot.faults import fault
    from fake_robot.faults.registry import make_fault

    before = dict(fault.FAULTS)

    class ThrownAway(fault.Fault, name="thrown_away"):
        """A class with a name is a fault."""

    try:
        assert make_fault("thrown_away", {}) == ThrownAway()
    finally:
        fault.FAULTS.pop("thrown_away")
    assert before == fault.FAULTS
    for name in ("StateGap", "LowBattery"):
        assert len(naming(f"class {name}(", "fake_robot")) == len(naming(name, "fake_robot")) == 1


def test_a_hal_adapter_is_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from spot_runtime.config import RunConfig
    from spot_runtime.hal.registry import Adapter, HalRequest, find_adapter

    (tmp_path / "thrown_away_hal.py").write_text(
        "from spot_runtime.hal.registry import Adapter\n\n\n"
        "def adapter(request):\n    return Adapter(request.robot, lambda sink: None)\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    config = RunConfig.model_validate({"robot": {"hal": "thrown_away_hal:adapter"}})
    found = find_adapter(HalRequest("somewhere", config))
    assert isinstance(found, Adapter)
    assert found.robot == "somewhere"


def test_every_command_is_a_module_and_a_line() -> None:
    from importlib.metadata import entry_points

    for entry in entry_points(group="spot_rl.commands"):
        path = home(entry.module.split(".")[0]) / Path(*entry.module.split(".")).with_suffix(".py")
        assert path.exists(), entry.value


def test_what_guards_a_robot_is_never_left_out_of_the_tests_of_a_change() -> None:
    core = runpy.run_path(str(ROOT / "scripts" / "safety_core.py"))["TESTS"]
    guards = (*core, *(f"tests/spot_runtime/{name}.py" for name in ("faults/test_matrix", "operator/test_guardian")))
    assert not [file for file in guards if "mark.slow" in (ROOT / file).read_text(encoding="utf-8")]
