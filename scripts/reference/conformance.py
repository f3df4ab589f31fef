"""docs/reference/conformance.md: what a robot may refuse."""

from __future__ import annotations

from fake_robot.conformance.command import markdown

from .words import page

ABOUT = """\
Every check that the fake robot makes on a client, and every answer that a client may rely on, with its source. The
fake robot refuses everything that a robot may refuse according to the protos. Undocumented behaviour is marked *our
guess*; the last column names the key of the [scenario](scenario.md) that changes the fake robot's answer.
[Any server can be held against it](../other-tools.md#other-servers)."""


def conformance_page() -> str:
    """The page."""
    return page("What a robot may refuse", ABOUT, [markdown()])
