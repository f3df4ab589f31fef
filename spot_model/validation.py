"""Turning a validation error into lines that a person can act on."""

from __future__ import annotations

from pydantic import ValidationError


def explain(error: ValidationError) -> str:
    """One line a problem: the key's path, the value that was given, and what is wrong or allowed."""
    lines = []
    for problem in error.errors(include_url=False):
        where = ".".join(str(part) for part in problem["loc"]) or "file"
        value = "" if problem["type"] == "missing" else f" = {_short(problem['input'])}"
        lines.append(f"  {where}{value}: {problem['msg']}")
    return "\n".join(lines)


def _short(value: object, limit: int = 80) -> str:
    text = repr(value)
    return text if len(text) <= limit else f"{text[: limit - 1]}…"
