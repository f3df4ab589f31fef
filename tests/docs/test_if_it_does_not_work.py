"""Each message that the page quotes is one of the code; what is not quoted is said in words."""

from __future__ import annotations

import ast
import re

from .blocks import REPOSITORY

PAGE = REPOSITORY / "docs" / "if-it-does-not-work.md"
PACKAGES = ("spot_model", "spot_log", "spot_runtime", "spot_tools", "fake_robot", "trainer", "diagnosis", "compare")
OF_OTHERS = {"command not found: spot-rl", "spot-rl: command not found", "ws://localhost:8765"}
"""What a shell says, and an address that the reader has typed."""


def quoted() -> list[str]:
    """Messages in the first column of all tables."""
    rows = [line.split(" | ")[0] for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    return [message for row in rows for message in re.findall(r"`([^`]+)`", row) if message not in OF_OTHERS]


def said() -> str:
    """All texts of the code, and the names of enumerations, which are the reasons of stops."""
    found: list[str] = []
    for file in (file for package in PACKAGES for file in (REPOSITORY / package).rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(node.value)
            elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                found.append(node.targets[0].id.lower())
    return "\0".join(found)


def test_quoted_messages_are_in_the_code() -> None:
    """The parts of each, between its ellipses."""
    parts = [part for message in quoted() for part in re.split(r"\s*…\s*", message) if part]
    text = said()
    assert len(parts) > 30
    assert not [part for part in parts if part not in text]
