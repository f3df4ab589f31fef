"""Text from robots, policies and logs reaches terminals and pages without what they would obey."""

from __future__ import annotations

import io

import pytest

from spot_log.page.draw import esc
from spot_model.console.command_line import error_line
from spot_model.errors import BadInputError
from spot_model.text import parameter_words, plain, plain_lines
from spot_protos import operator_pb2
from spot_runtime.host.journal import Console
from spot_tools.checks import DoctorCheck, ok
from spot_tools.client import plain_message

ATTACKS = (
    "\x1b]0;owned\x07",
    "\x1b[2J\x1b[H",
    "\x9b31m",
    "line\rover",
    "\u202egnp.exe",
    "a\u2028b",
    "zero\u200bwidth",
    "tab\tand\nline",
)


@pytest.mark.parametrize("text", ATTACKS)
def test_nothing_that_a_terminal_obeys_is_left(text: str) -> None:
    assert plain(text).isprintable()
    assert len(plain(text)) == len(text)
    assert plain_lines(text).replace("\n", "").replace("\t", "").isprintable()


def test_ordinary_text_stays_as_it_is() -> None:
    for text in ("walk", "0.5 m/s → 80 N·m, 12 °C", "Zürich, 東京", "−1 µs"):
        assert plain(text) == plain_lines(text) == text
    assert plain_lines("one\n\ttwo") == "one\n\ttwo"


@pytest.mark.parametrize("text", ATTACKS[:6])
def test_every_way_out_uses_it(text: str) -> None:
    stream = io.StringIO()
    console = Console(stream)
    console.say(text)
    console.close()
    told = DoctorCheck("name", lambda: ok(text)).make()
    status = operator_pb2.Status(robot=text, run=operator_pb2.RunStatus(faults=[text], log_path=text))
    status.last.sentence = text
    plain_message(status)
    for shown in (
        stream.getvalue().removesuffix("\n"),
        error_line(BadInputError(text), "run", is_debug=False),
        esc(text),
        told.found,
        status.robot,
        status.run.faults[0],
        status.run.log_path,
        status.last.sentence,
    ):
        assert shown.isprintable()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("copper_w_per_nm2", "copper"),
        ("torque_max_nm", "torque max"),
        ("drag_n_s_per_m", "drag"),
        ("cycles_per_rad", "cycles"),
        ("gain", "gain"),
    ],
)
def test_a_parameter_is_named_without_its_unit(name: str, words: str) -> None:
    assert parameter_words(name) == words
