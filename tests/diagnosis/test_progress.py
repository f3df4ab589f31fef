import ast
import io
from pathlib import Path

import pytest
from rich.console import Console

import diagnosis
from diagnosis.session import STAGES, DiagnosisProgress


class _Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def test_every_stage_is_the_beginning_of_something_that_is_said() -> None:
    folder = Path(diagnosis.__file__).parent
    said = []
    for file in folder.rglob("*.py"):
        for call in ast.walk(ast.parse(file.read_text())):
            if isinstance(call, ast.Call) and getattr(call.func, "id", "") in ("say", "progress") and call.args:
                text = call.args[0].values[0] if isinstance(call.args[0], ast.JoinedStr) else call.args[0]
                said.append(str(getattr(text, "value", "")))
    for begin, share in STAGES:
        assert any(text.startswith(begin) for text in said), begin
        assert 0.0 < share < 1.0
    assert sum(share for _, share in STAGES) == pytest.approx(1.0)


def test_stage_share_and_time_left_in_a_file() -> None:
    clock, stream = _Clock(), io.StringIO()
    progress = DiagnosisProgress(Console(file=stream, width=200), clock)
    progress("reading logs")
    clock.now_s = 10.0
    progress("building channels of 3 logs")
    progress.at(0.5)
    progress("a note")
    progress.stop()
    lines = stream.getvalue().splitlines()
    assert lines[0] == "diagnosis 0 %  reading logs"
    # A hundredth says nothing of the pace; half of the next eight have come, and as much is left of them.
    assert lines[1] == "diagnosis 1 %  building channels of 3 logs"
    assert lines[2] == "diagnosis 5 %  left 3:10  a note"
    assert progress.share == pytest.approx(0.01 + 0.08 * 0.5)


def test_the_share_never_falls() -> None:
    clock = _Clock()
    progress = DiagnosisProgress(Console(file=io.StringIO()), clock)
    shares = []
    for text, _ in STAGES:
        progress(text)
        for part in (0.2, 0.9, 0.4):
            clock.now_s += 1.0
            progress.at(part)
            shares.append(progress.share)
    assert shares == sorted(shares)
    assert shares[-1] < 1.0
