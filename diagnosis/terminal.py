"""The verdict in twelve lines."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from diagnosis.document import FoundEffect, Verdict
from spot_model.robot.facts import JOINT_NAMES, JOINT_TYPES

GROUPS = {
    told: {n for n in JOINT_NAMES if n.endswith(kind)}
    for kind, told in zip(JOINT_TYPES, ("all sideways hips (hx)", "all forward hips (hy)", "all knees"), strict=True)
}
"""Joints of one type."""

WORDS = {
    "explained": "explained: the effects below account for the gap",
    "partly_explained": "partly explained: the effects below, and something else",
    "unknown_effect": "unknown effect: nothing in the library explains the gap",
    "no_gap": "no gap: the robot differs from the nominal model by ordinary errors alone",
    "cannot_tell": "cannot tell: these logs lack what would show it",
}


def twelve_lines(verdict: Verdict, paths: Mapping[str, Path]) -> list[str]:
    """Twelve lines for a terminal."""
    v = verdict
    used = sum(s == "used" for s in v.channels.values())
    lines = [
        f"verdict    {WORDS[v.status]}",
        f"logs       {len(v.logs)}; {used} of {len(v.channels)} channels can be used",
        f"where      {_where(v)}",
    ]
    effects = [f"effect     {_effect(e)}" for e in v.effects[:3]] or [f"effect     none found{_seen(v)}"]
    lines += effects
    lines.append(
        f"otherwise  probability of no effect {v.probability_none:.2f}, of an unknown one "
        f"{v.probability_unknown:.2f}{_unknown(v)}"
    )
    lines.append(f"shrink     {_shrink(v)}")
    # With fewer effects there is room for more.
    lines += [f"signals    {_beside(v)}", f"invisible  {_invisible(v)}"][: 3 - len(effects)]
    split = next((e.split for e in v.effects if e.split is not None), None)
    lines.append(f"to decide  {split.command if split else 'no experiment is needed'}")
    lines.append(f"advice     {v.log_advice[0] if v.log_advice else 'none'}")
    lines.append(f"model      {paths.get('model', '-')}")
    lines.append(f"report     {paths.get('report', '-')}")
    return lines


def joints_in_short(joints: tuple[str, ...]) -> str:
    """Joints in few words."""
    if set(joints) == set(JOINT_NAMES):
        return "all joints"
    whole = [g for g, members in GROUPS.items() if members <= set(joints)]
    rest = [j for j in joints if not any(j in GROUPS[g] for g in whole)]
    return ", ".join(whole + rest)


def _effect(e: FoundEffect) -> str:
    values = ", ".join(
        f"{n} {p.value:.4g} ({p.low:.4g} to {p.high:.4g}) {p.unit}".rstrip() for n, p in e.parameters.items()
    )
    group = f" [or {', '.join(e.group[1:])}]" if len(e.group) > 1 else ""
    return f"{e.name}{group}, probability {e.probability:.2f}, at {joints_in_short(e.joints)}: {values}"


def _seen(v: Verdict) -> str:
    names = ", ".join(f"{s.name} at {joints_in_short(s.joints)}" for s in v.seen)
    return f"; seen, but without influence here: {names}" if names else ""


def _where(v: Verdict) -> str:
    if not v.where:
        simulated = v.shrink is not None or not any("no gap map" in note for note in v.notes)
        return "no cell exceeds its floor" if simulated else "not measured: the nominal model was not simulated"
    c = v.where[0]
    ratio = f", {c.ratio:.1f} times its floor" if c.ratio is not None else ""
    return f"{c.signal} of {c.joint}, {c.regime}: {c.gap:.3g} {c.unit}{ratio}"


def _beside(v: Verdict) -> str:
    if v.shrink is None or not v.shrink.beside:
        return "no gaps of torque and velocity"
    return "; ".join(
        f"{o.name} {o.before:.3g} to {o.after:.3g} {o.unit}{f', floor {o.floor:.3g}' if o.floor > 0.0 else ''}"
        for o in v.shrink.beside
    )


def _invisible(v: Verdict) -> str:
    return ", ".join(v.invisible) if v.invisible else "none: these logs could show every effect"


def _unknown(v: Verdict) -> str:
    if v.unknown is None:
        return ""
    return f": {', '.join(v.unknown.joints)}, {v.unknown.regime}, depends on {' and '.join(v.unknown.depends_on)}"


def _shrink(v: Verdict) -> str:
    s = v.shrink
    if s is None:
        return "not measured"
    if s.s is None or s.s_low is None or s.s_high is None:
        return f"D0 {s.d0:.2f} does not exceed its floor {s.floor:.2f}"
    placebo = f"; placebo {s.placebo.name} {s.placebo.s:.2f}" if s.placebo else ""
    interval = f"90 % interval {s.s_low:.2f} to {s.s_high:.2f}"
    whose = "" if s.floor_of == "robot" else " of simulated runs"
    return f"S {s.s:.2f} ({interval}): distance {s.d0:.2f} to {s.d1:.2f}, floor{whose} {s.floor:.2f}{placebo}"
