"""The page of what to record next: what to run, what it costs, and which number gets how much surer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from diagnosis.next.doubts import WORTH
from diagnosis.next.menu import Menu, Recording
from diagnosis.report import words
from spot_log.page.look import boxed, framed, headed, table
from spot_log.page.rows import Bar, bars
from spot_log.page.svg import esc, legend

MOST: Final = 5
"""Numbers that are drawn: those that become surest."""


def menu_page(menu: Menu, commands: Sequence[str]) -> str:
    """The page as text; ``commands`` run the best recording, and then diagnose again."""
    best, body = menu.best, []
    if best is None:
        body.append(headed("Nothing worth running", "fair", "No recording is worth its time", [menu.nothing]))
    else:
        own = best.candidate
        cost = f"{own.robot_s:.0f} s of robot time · needs {own.needs} · loads {best.loads}"
        cost += " · the logs hold it already" if best.is_held else ""
        title = f"{own.name.replace('_', ' ').capitalize()}: {own.title}"
        body += [
            headed("Run this next", "good", title, [], cost),
            boxed(
                "How much surer", "Half-widths of 90 % intervals, from a simulated run beside the logs.", _drawn(best)
            ),
            boxed("Run it, and diagnose all logs again", "", f"<pre>{esc(chr(10).join(commands))}</pre>"),
        ]
    about = f"Worth running is what narrows one number's interval by {words.percent(WORTH)} or more."
    rows = [
        (f"{r.candidate.name}: {r.candidate.title}", f"{r.candidate.robot_s:.0f} s", *_told(r)) for r in menu.recordings
    ]
    head = ("recording", "robot time", "narrower by, on average", "most, or why not")
    return framed("What to record next", [*body, boxed("All that was weighed", about, table(head, rows))])


def _drawn(r: Recording) -> str:
    """For each number a bar of what is in doubt now, and of what is expected."""
    doubts = r.ranked[:MOST]
    largest = max([1.0, *(r.after(d) / d.now for d in doubts)])
    drawn = []
    for d in doubts:
        sides = ((d.now, "var(--nominal)"), (r.after(d), "var(--corrected)"))
        group = [Bar(size / d.now / largest, colour, d.told(size)) for size, colour in sides]
        drawn.append(f"<h3>{esc(d.title)}</h3>{bars([('', '', group)], d.title, left=0, right=90)}")
    return legend([("var(--nominal)", "now"), ("var(--corrected)", "expected after it")]) + "".join(drawn)


def _told(r: Recording) -> tuple[str, str]:
    if r.refused or not r.doubts:
        return "", f"refused: {'; '.join(r.refused)}" if r.refused else "nothing is in doubt"
    most = r.ranked[0]
    return words.percent(r.gain), f"{most.title}: {most.told(most.now)} → {most.told(r.after(most))}"
