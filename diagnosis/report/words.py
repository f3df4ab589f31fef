"""The verdict in plain sentences; the first says what to do next."""

from __future__ import annotations

from typing import Final

from diagnosis.document import FoundEffect, Shrink, Verdict
from diagnosis.library.registry import LIBRARY
from diagnosis.terminal import joints_in_short

WIDEST: Final = 1.0
"""An interval of S wider than this tells nothing: from no change at all to the whole gap."""
BADGES: Final = {
    "explained": "Explained",
    "partly_explained": "Partly explained",
    "unknown_effect": "Unknown effect",
    "no_gap": "No gap",
    "cannot_tell": "Cannot tell",
}


def plain(name: str) -> str:
    """What an effect is called among people; the name as words where it is none of the library's."""
    return LIBRARY[name].title if name in LIBRARY else name.replace("_", " ")


UNITS: Final = (
    "_nm_s_per_rad",
    "_v_s_per_rad",
    "_k_per_nm2_s",
    "_rad_per_nm",
    "_w_per_nm2",
    "_nm_per_v",
    "_cycles_per_rad",
    "_kg_m2",
    "_rad_s",
    "_m_s2",
    "_per_k",
    "_m_s",
    "_kg",
    "_nm",
    "_rad",
    "_ohm",
    "_w",
    "_v",
    "_s",
    "_m",
    "_k",
)


def parameter(name: str) -> str:
    """A parameter's name as words, without the unit at its end: that stands beside the value."""
    end = next((u for u in UNITS if name.endswith(u) and len(name) > len(u)), "")
    return name.removesuffix(end).replace("_", " ")


CERTAIN: Final = 0.8
CLOSES: Final = 0.7
"""A verdict is green from this probability and this share of the gap on."""


def is_green(v: Verdict) -> bool:
    """Whether the verdict is right by both: every cause is probable, and the model with them closes the gap."""
    if v.status != "explained" or not v.effects or v.shrink is None or v.shrink.s is None:
        return False
    return all(e.probability >= CERTAIN for e in v.effects) and v.shrink.s >= CLOSES


def headline(v: Verdict) -> str:
    """What a person should do next, and why, in one sentence."""
    told = " and ".join(_found(e) for e in v.effects[:3])
    split = next((e.split for e in v.effects if len(e.group) > 1 and e.split is not None), None)
    if v.status == "no_gap":
        return "Train on this model: the robot differs from it by ordinary errors alone"
    if v.status == "unknown_effect":
        where = f" at {joints_in_short(v.unknown.joints)}" if v.unknown and v.unknown.joints else ""
        what = f"something acts{where} that no effect of the library explains"
        if v.unknown is not None and v.unknown.formula is not None:
            return f"Diagnose again with unknown_effect.py: {what}, and a formula predicts it"
        return f"Look at the robot{where}: something acts there that no effect of the library explains"
    if v.status == "cannot_tell" or not v.effects:
        return "Record more: these logs cannot tell"
    if is_green(v):
        return f"Train on the corrected model: {told} explains the gap"
    if split is not None:
        return f"{split.text.split(':')[0].rstrip('.')} and record it: it is {told}, and these logs cannot tell"
    if v.status == "partly_explained":
        return f"Train on the corrected model, and look further: {told}, and something unknown"
    return f"Record more to be sure: it may be {told}"


def _found(e: FoundEffect) -> str:
    title = " or ".join(plain(n) for n in e.group) if len(e.group) > 1 else e.title or plain(e.name)
    at = f" at {joints_in_short(e.joints)}" if e.joints and len(e.joints) < 12 else ""
    return title + at


def second_line(v: Verdict) -> str:
    """The size of it, and how far the gap shrinks."""
    parts = []
    for e in v.effects[:2]:
        if v.status in ("explained", "partly_explained") and e.parameters:
            name, p = next(iter(e.parameters.items()))
            unit = f" {p.unit}" if p.unit not in ("", "1") else ""
            parts.append(
                f"{parameter(name).capitalize()} {p.value:.3g}{unit} (90 % interval {p.low:.3g} to {p.high:.3g})."
            )
    if v.unknown is not None and v.unknown.depends_on:
        parts.append(f"What is left depends most on {' and '.join(v.unknown.depends_on)}.")
    s = v.shrink
    if s is not None and s.s is not None and v.effects:
        what = "Added to the simulator, it closes"
        if v.status == "unknown_effect":
            what = f"The best that the library has, {_found(v.effects[0])}, closes"
        elif len(v.effects) > 1:
            what = "Added to the simulator, they close"
        parts.append(f"{what} {_share(s)}.")
    named = "; ".join(f"{_found(e)} {100 * e.probability:.0f} %" for e in v.effects[:2])
    none = f"no effect {100 * v.probability_none:.0f} %; an unknown one{', alone or beside these,' if named else ''}"
    parts.append(f"Probabilities: {named + '; ' if named else ''}{none} {100 * v.probability_unknown:.0f} %.")
    return " ".join(parts)


def _share(shrink: Shrink) -> str:
    """How much of the gap closes; an interval as wide as the gap itself is told as what it is."""
    assert shrink.s is not None  # noqa: S101  (the caller asks)
    told = f"{100 * shrink.s:.0f} % of the gap"
    if shrink.s_low is None or shrink.s_high is None:
        return told
    if shrink.s_high - shrink.s_low > WIDEST:
        return f"{told}; with so few runs, this is uncertain"
    return f"{told} (90 %: {100 * shrink.s_low:.0f} to {100 * shrink.s_high:.0f} %)"
