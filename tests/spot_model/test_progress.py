"""Progress with and without a terminal."""

from __future__ import annotations

import io
import time
from itertools import pairwise

from rich.console import Console

from spot_model.console.progress import PLAIN_INTERVAL_S, Progress


class Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def plain() -> tuple[Console, io.StringIO]:
    out = io.StringIO()
    return Console(file=out, force_terminal=False, width=200), out


def test_without_a_terminal_a_line_now_and_then_and_the_last():
    console, out = plain()
    clock = Clock()
    with Progress("cases", 10, console=console, clock=clock) as progress:
        for done in range(1, 11):
            clock.now_s += PLAIN_INTERVAL_S / 4
            progress.update(done, f"case {done}")
    lines = out.getvalue().splitlines()
    assert [line.split()[1] for line in lines] == ["1/10", "5/10", "9/10", "10/10"]
    # 5 took 18.75 s, so 5 more take as long.
    assert lines[1] == "cases 5/10  left 0:18  case 5"


def test_resumed_work_counts_its_time_from_where_it_began():
    console, out = plain()
    clock = Clock()
    progress = Progress("generations", 100, done=90, console=console, clock=clock)
    clock.now_s += 10.0
    progress.update(95)
    assert out.getvalue() == "generations 95/100  left 0:10\n"


def test_what_is_told_stays_even_between_two_lines():
    console, out = plain()
    clock = Clock()
    progress = Progress("cases", 10, console=console, clock=clock)
    progress.update(1, "fine")
    progress.update(2, "failed: no robot", is_told=True)
    progress.update(3, "fine")
    assert "failed: no robot" in out.getvalue()
    assert "3/10" not in out.getvalue()


def test_on_a_terminal_it_is_a_bar_that_is_left_at_its_last_state():
    out = io.StringIO()
    console = Console(file=out, force_terminal=True, width=120)
    with Progress("cases", 4, console=console) as progress:
        progress.update(4, "[not markup]")
    assert "4/4" in out.getvalue()


def test_the_time_left_never_stands_still_and_a_late_part_never_counts_as_done():
    """A part that the pace so far gives 20 s takes twenty minutes."""
    console, out = plain()
    clock = Clock()
    with Progress("diagnosis", console=console, clock=clock) as progress:
        clock.now_s += 80.0
        progress.update(80, "weighing", ahead=18)
        for _ in range(60):
            clock.now_s += 20.0
            progress._show()
    lines = out.getvalue().splitlines()
    left_s = [60 * int(m) + int(s) for m, s in (line.split()[4].split(":") for line in lines)]
    shares = [int(line.split()[1]) for line in lines]
    assert left_s[0] == 20
    assert all(a != b for a, b in pairwise(left_s))
    assert abs(left_s[-1] - 242) <= 1  # a fifth of what the part has taken, and 2 s for what comes after it
    assert shares == sorted(shares)
    assert shares[-1] == 97


def test_time_alone_moves_it_on(monkeypatch):
    console, out = plain()
    monkeypatch.setattr("spot_model.console.progress.TICK_S", 0.001)
    clock = Clock()
    with Progress("cases", 10, console=console, clock=clock) as progress:
        clock.now_s += 10.0
        progress.update(1, "first")
        clock.now_s += 2 * PLAIN_INTERVAL_S
        # Whether a tick printed a line before the update or not, the next one is due now.
        while "cases 1/10  left 1:26  first\n" not in out.getvalue():
            time.sleep(0.001)
