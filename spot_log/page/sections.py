"""What a page is made of: a page is a list of these, and ``render.py`` writes it. Each shows nothing if it is empty.

Words are a text, a number, None for what is not known, a :class:`Mark`, or a tuple of these, one behind the other.
Content is one part, a list of parts, or words, which are a paragraph. Colours may be variables of the style.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from numpy.typing import ArrayLike

Words = Any
Content = Any


class Mark(NamedTuple):
    """Words with a look: bold (b), code, pre for lines that stay as they are, or a class; a click leads to ``link``."""

    words: str
    look: str = "b"
    link: str = ""


class Head(NamedTuple):
    """The first box: a verdict in a word and its kind (good, fair, bad, none, unknown), a headline, sentences."""

    badge: str
    kind: str
    headline: str
    lines: Iterable[str] = ()
    meta: str = ""


class Section(NamedTuple):
    """A box with a heading and a line of explanation; within another, a part with a small heading."""

    title: str
    about: str
    content: Content
    look: str = ""


class Fold(NamedTuple):
    """Content that opens on a click."""

    title: str
    content: Content


class Beside(NamedTuple):
    """Parts side by side, in 2, 3 or 4 columns where there is room for them."""

    parts: Sequence[Content]
    columns: int = 2


class Items(NamedTuple):
    """A list of words."""

    items: Iterable[Words]
    is_numbered: bool = False


class Table(NamedTuple):
    """A table, with a look for each row. Without a head, its first column holds names."""

    head: Sequence[str]
    rows: Iterable[Sequence[Words]]
    looks: Sequence[str] = ()


class Legend(NamedTuple):
    """Colours and what they mean; an entry without words is left out."""

    entries: Iterable[tuple[str, str]]


class Series(NamedTuple):
    """One line of a chart, x and y of shape (n,), with a gap where y is not finite; ``name`` is for the tips of points.

    A stepped line holds each value until the next.
    """

    colour: str
    x: ArrayLike
    y: ArrayLike
    width: float = 1.6
    is_dotted: bool = False
    is_stepped: bool = False
    is_filled: bool = False
    has_points: bool = False
    name: str = ""


class Shade(NamedTuple):
    """A stretch of the horizontal axis."""

    start: float
    end: float
    tip: str
    colour: str = "var(--cause)"


class Chart(NamedTuple):
    """Lines on common axes, later ones on top; ``height`` is that of the plot in pixels, ``about`` is below the title.

    The unit is behind each number of the horizontal axis; None: no such axis. The vertical axis shows ``y_range``, or
    what the lines need: from 0 on if ``zero``, and ``least_span`` at least. Names of ``rows`` stand at 0, −1, −2 and so
    on, instead of its numbers.
    """

    lines: Sequence[Series]
    y_title: str = ""
    title: str = ""
    about: str = ""
    x_title: str = ""
    x_unit: str | None = ""
    height: float = 190
    shades: Sequence[Shade] = ()
    zero: bool = False
    least_span: float = 0.0
    y_range: tuple[float, float] | None = None
    rows: Sequence[str] = ()


class Bar(NamedTuple):
    """One bar of a group: its length as a share of the full one, and words behind it."""

    share: float
    colour: str
    words: str
    tip: str = ""


class Bars(NamedTuple):
    """Groups of bars: name, what stands small below it, and bars. ``label`` is for those who cannot see them."""

    groups: Sequence[tuple[str, str, Sequence[Bar]]]
    label: str


class Cell(NamedTuple):
    """One place on a map: its share of the scale of colours, 0 to 1; None where nothing is known."""

    share: float | None
    tip: str = ""
    words: str = ""


class Map(NamedTuple):
    """A map of colours: rows down, columns across; ``scale`` has the words below the scale of colours."""

    columns: Sequence[str]
    rows: Sequence[tuple[str, Sequence[Cell]]]
    label: str
    title: str = ""
    scale: Sequence[str] = ()


class SpotMap(NamedTuple):
    """A drawing of Spot, with cells by the joint's name; joints, or ``body``, that are named have a blue frame."""

    cells: Mapping[str, Cell]
    named: Iterable[str]
    scale: Sequence[str]
