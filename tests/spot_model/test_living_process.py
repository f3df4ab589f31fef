"""Whether another process lives is never guessed: what the system refuses to tell is no end."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import pytest

from spot_model.process.child_process import LivingProcess


@pytest.fixture
def sleeper() -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"]) as process:
        yield process
        process.kill()


@pytest.mark.parametrize("refused", [None, errno.ENOSYS, errno.EPERM, errno.EMFILE])
def test_a_process_lives_until_it_has_ended(
    sleeper: subprocess.Popen[bytes], monkeypatch: pytest.MonkeyPatch, refused: int | None
) -> None:
    def refuse(*_: int) -> NoReturn:
        raise OSError(refused, "refused")

    if refused is not None:
        monkeypatch.setattr(os, "pidfd_open", refuse)
    watched = LivingProcess(sleeper.pid)
    assert not watched.has_ended()
    assert not watched.has_ended(0.3)
    sleeper.kill()
    # Nobody has reaped it yet.
    assert watched.has_ended(30.0)
    assert watched.has_ended()
    sleeper.wait()
    assert watched.has_ended(None)


def test_one_that_is_gone_has_ended() -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
    assert LivingProcess(process.pid).has_ended()
    assert LivingProcess(0).has_ended(None)


def test_another_process_of_its_number_is_not_taken_for_it(
    sleeper: subprocess.Popen[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: int) -> NoReturn:
        raise OSError(errno.ENOSYS, "refused")

    monkeypatch.setattr(os, "pidfd_open", refuse)
    watched = LivingProcess(sleeper.pid)
    monkeypatch.setattr("spot_model.process.child_process._began", lambda _: "another time")
    assert watched.has_ended()


def test_a_process_table_that_cannot_be_read_tells_of_no_end(
    sleeper: subprocess.Popen[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: int) -> NoReturn:
        raise OSError(errno.EMFILE, "refused")

    monkeypatch.setattr(os, "pidfd_open", refuse)
    watched = LivingProcess(sleeper.pid)
    with monkeypatch.context() as patched:
        patched.setattr(Path, "read_text", refuse)
        assert not watched.has_ended()
        begun_blind = LivingProcess(sleeper.pid)
        assert not begun_blind.has_ended()
    assert not begun_blind.has_ended()
    sleeper.kill()
    assert begun_blind.has_ended(30.0)
