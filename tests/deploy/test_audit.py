"""The audit says what it did not do, and that it could not is no success."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

AUDIT = Path(__file__).resolve().parents[2] / "scripts" / "audit.py"


@pytest.fixture(scope="module")
def audit() -> ModuleType:
    spec = importlib.util.spec_from_file_location("audit", AUDIT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def answer(audit: ModuleType, monkeypatch: pytest.MonkeyPatch, code: int, said: str) -> list[str]:
    done = subprocess.CompletedProcess([], code, "", said)
    monkeypatch.setattr(audit.subprocess, "run", lambda *_, **__: done)
    problems: list[str] = audit.known_holes()
    return problems


def test_offline_it_says_that_advisories_were_not_checked(
    audit: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(sys, "argv", ["audit.py", "--sbom", str(tmp_path / "b" / "sbom.json")])
    for check in ("loose_requirements", "problems_of_installed", "unhashed"):
        monkeypatch.setattr(audit, check, list)
    audit.main()
    assert "advisories of known holes were NOT checked: that needs a network" in capsys.readouterr().out
    bill = json.loads((tmp_path / "b" / "sbom.json").read_text(encoding="utf-8"))
    assert bill["bomFormat"] == "CycloneDX"
    assert {"cryptography", "onnxruntime", "protobuf"} <= {part["name"] for part in bill["components"]}


def test_asked_for_and_not_possible_is_a_problem(audit: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "not installed" in answer(audit, monkeypatch, 1, "No module named pip_audit")[0]
    assert "numpy: not found" in answer(audit, monkeypatch, 1, "numpy: not found")[0]
    assert answer(audit, monkeypatch, 0, "No known vulnerabilities found") == []


def test_a_loose_or_foreign_requirement_is_a_problem(
    audit: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "pyproject.toml").write_text(
        '[project]\ndependencies = ["numpy>=2", "typer==0.1", "x @ https://example.com/x.whl"]\n'
        "[project.optional-dependencies]\n",
        encoding="utf-8",
    )
    monkeypatch.setattr(audit, "REPOSITORY", tmp_path)
    assert [line.split("'")[1].split(">")[0].split(" ")[0] for line in audit.loose_requirements()] == ["numpy", "x"]
