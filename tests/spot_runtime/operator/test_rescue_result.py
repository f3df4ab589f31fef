"""A robot is safe when its note is gone, whatever exit code the system hands out for the process that saw to it."""

from __future__ import annotations

from pathlib import Path

import pytest

from spot_model.process.child_process import HEARD, ChildProcess
from spot_runtime.operator.server.run_process import Rescue
from spot_runtime.rescue.make_safe import WAITING

from .conftest import wait_until


@pytest.mark.parametrize(
    ("code", "has_note", "is_safe"), [(0, False, True), (0, True, False), (79, True, False), (79, False, False)]
)
def test_safe_is_what_leaves_no_note(tmp_path: Path, code: int, has_note: bool, is_safe: bool) -> None:
    note = tmp_path / "note"
    if has_note:
        note.write_text("{}")
    process = ChildProcess.start(["sh", "-c", f"echo done; exit {code}"], output=HEARD)
    process.wait(30.0)
    assert Rescue(process, note).result() == (is_safe, "done")


def test_it_tells_for_whose_lease_it_waits_until_it_has_done(tmp_path: Path) -> None:
    said = f"echo '{WAITING}a tablet has it'; read go; echo done"
    process = ChildProcess.start(["sh", "-c", said], output=HEARD)
    rescue = Rescue(process, tmp_path / "note")
    assert not rescue.waits
    wait_until(lambda: rescue.result() is not None or bool(rescue.waits), "it has said something")
    assert rescue.waits == f"{WAITING}a tablet has it"
    assert process._process.stdin is not None
    process._process.stdin.close()
    process.wait(30.0)
    assert rescue.result() == (True, "done")
    assert not rescue.waits
