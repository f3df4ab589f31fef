"""Runs the words of a page in a shell, beside programs that go on."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .blocks import REPOSITORY, Block, blocks_of

OFFLINE = {"PIP_NO_INDEX": "1", "PIP_NO_BUILD_ISOLATION": "0", "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
"""No network, and the builder that is installed. (0 is how pip spells *no isolation* in the environment.)"""

ENVIRONMENT = {n: v for n, v in os.environ.items() if not n.startswith(("PYTEST_", "PIP_", "MAKE")) and n != "ARGS"}
PROGRAMS = Path(sys.executable).parent


def block_with(page: str, command: str) -> Block:
    """The block of a page that holds a command."""
    path = REPOSITORY / (page if page.isupper() else f"docs/{page}").replace("docs/README", "README")
    return next(block for block in blocks_of(path.with_suffix(".md")) if command in block.text)


def bash(text: str, folder: Path, **more: str) -> str:
    """Run a page's words in a folder; what they print."""
    path = more.pop("PATH", f"{PROGRAMS}:{os.environ['PATH']}")
    told = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", text],
        cwd=folder,
        env={**ENVIRONMENT, "PATH": path, "XDG_STATE_HOME": f"{folder}-state", **more},
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
    )
    assert told.returncode == 0, f"{text}\n{told.stdout}\n{told.stderr}"
    return told.stdout


def write_program(path: Path, text: str) -> None:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


@contextlib.contextmanager
def said_until(words: str, command: list[str], folder: Path, environment: dict[str, str]) -> Iterator[list[str]]:
    """Start a program, wait for a line that holds some words, give the lines; end it after the block."""
    path = {"PATH": f"{PROGRAMS}:{os.environ['PATH']}"}
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "stdin": subprocess.DEVNULL}
    with subprocess.Popen(command, cwd=folder, env={**environment, **path}, text=True, **pipes) as process:
        assert process.stdout is not None
        said: list[str] = []
        try:
            while not said or words not in said[-1]:
                said.append(process.stdout.readline())
                assert said[-1], f"{command}: {said}"
            yield said
        finally:
            process.terminate()
            process.stdout.read()
