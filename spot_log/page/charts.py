"""Charts that several pages have: feet on the ground, and how often a value came."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from spot_log.page.sections import Chart, Series

FEET: Final = ("var(--floor)", "var(--group)", "var(--good)", "var(--unknown)")
"""Colours of the feet fl, fr, hl, hr."""


def liveliest(sizes: ArrayLike, length: int) -> slice:
    """The stretch of ``length`` rows, at least one, in which ``sizes``, shape (n,), sum up to most; NaN counts as 0."""
    sums = np.concatenate([[0.0], np.cumsum(np.nan_to_num(np.asarray(sizes, dtype=np.float64)))])
    length = max(1, min(length, len(sums) - 1))
    start = int(np.argmax(sums[length:] - sums[:-length]))
    return slice(start, start + length)


def stance(
    contact: ArrayLike, names: Sequence[str], colour: str, span_s: tuple[float, float] = (0.0, 0.0)
) -> Chart | None:
    """Feet on the ground, samples at even times, shape (n, feet), one row a foot; None where there is none.

    ``span_s`` has begin and end on the axis of time below; no axis without them.
    """
    down = np.asarray(contact, dtype=np.bool_)
    if down.ndim != 2 or down.shape[1] != len(names) or not len(down):
        return None
    has_axis = span_s[1] > span_s[0]
    first, last = span_s if has_axis else (0.0, float(len(down)))
    lines = []
    for foot in range(len(names)):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], down[:, foot].astype(int), [0]])))
        at = np.insert(first + (last - first) * edges.reshape(-1, 2) / len(down), 2, last, axis=1).ravel()
        lines.append(Series("var(--empty,#e6ebef)", [first, last], [-foot, -foot], width=14))
        lines.append(Series(colour, at, np.tile([-foot, -foot, np.nan], len(at) // 3), width=14))
    y_range, unit = (0.5 - len(names), 0.5), " s" if has_axis else None
    return Chart(lines, rows=names, height=18 * len(names), y_range=y_range, x_unit=unit)


def histogram(values: ArrayLike, title: str) -> Chart:
    """How often each finite value of shape (n,) came; what lies beyond the 99.5th percentile is counted in words."""
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    if not len(known):
        return Chart((), title=title, about="not known")
    low, top = float(known.min()), float(np.percentile(known, 99.5))
    counts, edges = np.histogram(known, bins=40, range=(low, top if top > low else low + 1.0))
    outline = np.concatenate([[0], np.repeat(counts, 2), [0]])
    lines = [Series("var(--floor)", np.repeat(edges, 2), outline, width=0, is_filled=True)]
    middle, most = (float(p) for p in np.percentile(known, [50, 99]))
    marks = ([value, value] for value in (middle, most))
    lines += [Series("var(--nominal)", x, [0, counts.max()], is_dotted=True) for x in marks]
    beyond, about = int(np.sum(known > edges[-1])), f"median {_rounded(middle)}, 99 % below {_rounded(most)}"
    about += f"\n{beyond} more, up to {_rounded(float(known.max()))}" if beyond else ""
    return Chart(lines, title=title, about=about, height=130, zero=True)


def _rounded(value: float) -> str:
    """Four digits, without an exponent where a person expects none."""
    return f"{float(f'{value:.4g}'):g}"
