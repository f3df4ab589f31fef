"""The page of what to record next: what to run, what it costs, and which number gets how much surer."""

from __future__ import annotations

from collections.abc import Sequence

from diagnosis.next.doubts import WORTH
from diagnosis.next.menu import Menu, Recording
from diagnosis.report import words
from spot_log.page.look import boxed, framed, headed, table
from spot_log.page.rows import Bar, bars
from spot_log.page.svg import esc, legend


def menu_page(menu: Menu, commands: Sequence[str]) -> str:
    """The page as text; ``commands`` run the best recording, and then diagnose again."""
    best, body = menu.best, []
    if best is None:
        body.append(headed("Nothing worth running", "fair", "No recording is worth its time", [menu.nothing]))
    else:
        lines = [words.sentence(told) for told in best.told[:2]]
        title = f"{best.candidate.title[:1].upper()}{best.candidate.title[1:]} ({best.candidate.name})"
        body += [
            headed("Run this next", "good", title, lines, best.cost),
            boxed("Run it, and diagnose all logs again", "", f"<pre>{esc(chr(10).join(commands))}</pre>"),
            boxed(
                "How much surer", "Half-widths of 90 % intervals, from a simulated run beside the logs.", _drawn(best)
            ),
        ]
    about = f"Worth running is what narrows one number's interval by {words.percent(WORTH)} or more."
    rows = [
        (f"{r.candidate.name}: {r.candidate.title}", f"{r.candidate.robot_s:.0f} s", *_row(r)) for r in menu.recordings
    ]
    head = ("recording", "robot time", "narrower by, on average", "most, or why not")
    return framed("What to record next", [*body, boxed("All that was weighed", about, table(head, rows))])


def _drawn(r: Recording) -> str:
    """For each number a bar of what is in doubt now, and of what is expected."""
    largest, drawn = max(1.0, 1.0 - min(r.drops, default=0.0)), []
    for d in r.doubts:
        sides = ((d.now, "var(--nominal)"), (r.after[d.key], "var(--corrected)"))
        group = [Bar(size / d.now / largest, colour, d.told(size)) for size, colour in sides]
        drawn.append(f"<h3>{esc(d.title)}</h3>{bars([('', '', group)], d.title, left=0, right=90)}")
    return legend([("var(--nominal)", "now"), ("var(--corrected)", "expected after it")]) + "".join(drawn)


def _row(r: Recording) -> tuple[str, str]:
    if r.refused or not r.doubts:
        return "", f"refused: {'; '.join(r.refused)}" if r.refused else "nothing is in doubt"
    return words.percent(r.gain), r.told[0]
