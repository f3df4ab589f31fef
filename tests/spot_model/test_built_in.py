"""Policies and configs by name, from any folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from spot_model.errors import BadInputError
from spot_model.policy.built_in import FOLDER, built_in_files, config_file, policy_file
from spot_model.policy.policy import load_policy


def test_every_built_in_policy_loads_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names = set(built_in_files(".onnx"))
    assert names == {"baseline", "bound", "fast", "walk", "walk_rough"}
    assert {load_policy(policy_file(name)).contract.name for name in names} == names
    assert config_file("walk_cpu") == FOLDER / "walk_cpu.yaml"
    assert "walk.card" not in built_in_files(".yaml")


def test_a_path_is_taken_as_it_is_and_a_name_wins_over_a_folder_of_that_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "walk").mkdir()
    assert policy_file("walk") == FOLDER / "walk.onnx"
    assert policy_file("./walk") == Path("walk")
    assert policy_file(tmp_path / "walk") == tmp_path / "walk"
    (tmp_path / "mine.onnx").touch()
    assert policy_file("mine.onnx") == Path("mine.onnx")


@pytest.mark.parametrize("given", ["wlak", "none.onnx", "policies/walk.onnx", ""])
def test_what_is_neither_a_name_nor_there_is_told_with_all_names(
    given: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BadInputError, match=r"allowed: the path of an ONNX file, or a built-in name: .*walk_rough"):
        policy_file(given)
