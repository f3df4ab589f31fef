"""Every row of the fault matrix, on one fake robot in lock-step; a row of minutes runs in the benchmark alone."""

from __future__ import annotations

import json
import math
import signal
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from proof.faults import command, rows_log
from proof.faults.attempts import row
from proof.faults.rows import Finding, Row, left_alone, tidy, try_row
from proof.faults.rows_process import Running
from proof.rig import CALM, Rig, rig
from spot_model.errors import BadInputError
from spot_model.process.child_process import ChildProcess
from tests.spot_runtime.file_sink import FileSink

WALK = Path(__file__).parents[3] / "policies" / "walk.onnx"

BRISK = "power: {power_on_s: 0.2, power_off_s: 0.1}\nmotion: {stand_s: 0.8, sit_s: 0.8}\n"
"""The default robot, but quicker to its feet: what happens before and after a fault costs a sixth of these tests."""

BRISK_HANDOVER = {
    **CALM["handover"],
    "ramp_in_s": 0.2,
    "ramp_out_s": 0.2,
    "soft_stop_s": 0.2,
    "soft_stop_settle_s": 0.2,
    "damping_s": 0.6,
}
"""For the same reason."""


def brisk(folder: Path) -> str:
    folder.mkdir(exist_ok=True)
    path = folder / "brisk.yaml"
    path.write_text(BRISK, encoding="utf-8")
    return str(path)


class Kept:
    """One robot for many rows, good before each; another after a row that has left it otherwise."""

    def __init__(self, folder: Path, closing: ExitStack) -> None:
        self._folder, self._closing = folder, closing
        self._rig: Rig | None = None
        self._count = 0

    def rig(self) -> Rig:
        if self._rig is None:
            self._count += 1
            folder = self._folder / str(self._count)
            self._rig = self._closing.enter_context(rig(folder, WALK, scenario=brisk(folder)))
            self._rig.calm = {**CALM, "handover": BRISK_HANDOVER}
        return self._rig

    def drop(self) -> None:
        self._rig = None
        self._closing.close()


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Kept]:
    with ExitStack() as closing:
        yield Kept(tmp_path_factory.mktemp("matrix"), closing)


@pytest.fixture
def robot(kept: Kept) -> Rig:
    return kept.rig()


ROWS = [replace(row, bound_ms=math.inf) if row.is_host_time else row for row in command.ROWS]
"""What the host's clock says is judged in the benchmark alone: a test may have a busy computer."""

SHARED = [row for row in ROWS if not row.is_long and not row.is_alone]
OF_THE_LOG = {row.fault for row in rows_log.ROWS}


@pytest.mark.parametrize("row", SHARED, ids=lambda row: row.fault)
def test_row(kept: Kept, row: Row) -> None:
    robot = kept.rig()
    # Only rows about the log want its process, which takes a sixth of a row's time to start; the file is the same.
    robot.make_sink = None if row.fault in OF_THE_LOG else FileSink.start
    result = tidy(robot, row, try_row(robot, row))
    if not result.ok:
        kept.drop()
    assert result.ok, result.to_json()


@pytest.mark.parametrize("row", [row for row in ROWS if row.is_alone], ids=lambda row: row.fault)
def test_row_that_leaves_the_robot_to_nobody_else(row: Row, tmp_path: Path) -> None:
    with rig(tmp_path, WALK, scenario=brisk(tmp_path)) as robot:
        result = try_row(robot, row)
    assert result.ok, result.to_json()


def test_names_are_unique_and_the_rows_of_time_are_there() -> None:
    names = [row.fault for row in command.ROWS]
    assert len(names) == len(set(names))
    assert sum(row.is_real_time for row in command.ROWS) >= 10


# The bench can fail --------------------------------------------------------------------------------------------------


def test_a_row_in_which_nothing_happens_fails(robot: Rig) -> None:
    nothing = row("nothing", 80.0, lambda *_: None, "state_stale", way="damping", at_s=1e6, seconds=0.3)
    result = try_row(robot, nothing)
    assert not result.ok
    assert any("ended completed" in problem for problem in result.problems)
    assert "the fault never happened" in result.problems
    assert "there was no damping" in result.problems


def test_a_row_that_breaks_or_comes_too_late_fails(robot: Rig) -> None:
    def broken(_: Rig) -> Finding:
        raise KeyError("nowhere")

    result = try_row(robot, Row("broken", 0.0, broken))
    assert not result.ok
    assert "KeyError" in result.problems[0]
    late = try_row(robot, Row("late", 80.0, lambda _: Finding("damping", 81.0)))
    assert late.problems == ("reacted after 81.0 ms",)
    assert late.to_json()["problems"] == ["reacted after 81.0 ms"]


def test_a_row_that_leaves_something_behind_fails(robot: Rig) -> None:
    class Hand:
        """Somebody whose faults no one clears."""

        def restore(self) -> str:
            robot.inject("estop_pressed")
            return robot.left_over(())

    row = Row("pressed", 0.0, lambda _: Finding("nothing"))
    result = tidy(Hand(), row, try_row(robot, row))  # type: ignore[arg-type]
    assert result.problems == ("left the fault estop_pressed, an e-stop at cut, the e-stop in the hands of nobody",)
    assert not result.ok
    assert robot.restore() == ""


def test_a_robot_that_is_left_stiff_fails(robot: Rig) -> None:
    class Stiff:
        def status(self) -> object:
            real = robot.status()
            real.mode, real.motor_power, real.lease_owner = "standing", "on", ""
            return real

        def truth(self) -> object:
            return robot.truth()

    finding = Finding()
    left_alone(Stiff(), finding)  # type: ignore[arg-type]
    assert finding.problems == ["left standing with motors on and nobody in charge"]


def test_the_command_prints_the_agreed_json(monkeypatch: pytest.MonkeyPatch) -> None:
    import typer

    app = typer.Typer()
    app.command()(command.faults)
    rows = [Row("one", 10.0, lambda _: Finding("damping", 5.0)), Row("two", 10.0, lambda _: Finding("damping", 50.0))]
    monkeypatch.setattr(command, "ROWS", rows)
    done = CliRunner().invoke(app, ["--json", "--policy", str(WALK)])
    assert done.exit_code == 1
    printed = json.loads(done.stdout)
    assert printed["failed"] == 1
    keys = "fault reaction reaction_ms bound_ms ok body_height_min_m peak_torque_nm log_ok"
    assert list(printed["rows"][0]) == keys.split()
    table = CliRunner().invoke(app, ["--only", "one", "--policy", str(WALK)])
    assert table.exit_code == 0
    assert "1 rows, 0 failed" in table.stdout
    with pytest.raises(BadInputError, match="no row's name holds 'three'; rows: one, two"):
        command.chosen("three", is_real_time=False, is_quick=False)


def running(program: str) -> Running:
    process = subprocess.Popen(["sh", "-c", program], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    return Running(ChildProcess(process), Path())


def test_what_hangs_is_killed_and_said() -> None:
    assert running("echo waiting >&2; exec sleep 600").finish(0.5) == (-signal.SIGKILL, "waiting\n", True)


def test_what_ends_by_itself_is_left_alone() -> None:
    assert running("echo done >&2; exit 3").finish() == (3, "done\n", False)
