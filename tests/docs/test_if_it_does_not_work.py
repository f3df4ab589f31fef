"""Each message that the page quotes is one of the code; what is not quoted is said in words."""

from __future__ import annotations

import ast
import re
from functools import cache

import pytest

from .blocks import REPOSITORY

PAGE = REPOSITORY / "docs" / "if-it-does-not-work.md"
PACKAGES = ("spot_model", "spot_log", "spot_runtime", "spot_tools", "fake_robot", "trainer", "diagnosis", "compare")
OF_OTHERS = {"command not found: spot-rl", "spot-rl: command not found", "ws://localhost:8765"}
"""What a shell says, and an address that the reader has typed."""


def quoted() -> list[str]:
    """Messages in the first column of all tables."""
    rows = [line.split(" | ")[0] for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    return [message for row in rows for message in re.findall(r"`([^`]+)`", row) if message not in OF_OTHERS]


@cache
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


def missing(message: str) -> list[str]:
    """Parts of a message, between its ellipses, that no text of the code has."""
    return [part for part in re.split(r"\s*…\s*", message) if part and part not in said()]


def test_the_page_has_many_messages() -> None:
    assert len(quoted()) > 30


@pytest.mark.parametrize("message", quoted())
def test_quoted_messages_are_in_the_code(message: str) -> None:
    assert missing(message) == []


def test_a_message_that_nobody_says_is_found() -> None:
    assert missing("no robot at … is made of cheese") == ["is made of cheese"]
