"""Old and new policy beside each other: what is better, what is worse, and whether to take the new one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

from scipy.stats import fisher_exact

from spot_model.robot.gait import HOPS

Trend = Literal["better", "worse", "same"]
Evaluation = Mapping[str, Any]

SPEED_SHARE: Final = 0.02
"""Share of the held speed; two runs of one policy differ by less."""
STANDS_M_S: Final = 0.03
ERROR_M_S: Final = 0.02
FOLLOWS_M_S: Final = 0.15
"""A policy follows a forward command whose speed it holds within this."""
LOST_M_S: Final = 0.05
"""Top speed that is bought with as large an error at commands that were followed is no gain."""
ERROR_RAD_S: Final = 0.03
WORK_SHARE: Final = 0.05
"""Differences that a person would not call one."""
CHANCE: Final = 0.05
"""Numbers of falls differ where chance alone would do as much less often than this (Fisher's exact test)."""


@dataclass(frozen=True)
class PolicyFigure:
    """One measure of both policies."""

    name: str
    unit: str
    old: str
    new: str
    kind: Trend
    is_decisive: bool = False
    """Whether a worse one forbids the new policy: speed, standing, falls, gait."""


def compared_figures(old: Evaluation, new: Evaluation) -> tuple[PolicyFigure, ...]:
    """All that two evaluations on the same robots have in common; the evaluations are those of ``spot-rl evaluate``."""
    return tuple(_figures(old, new))


def is_taken(found: tuple[PolicyFigure, ...]) -> bool:
    """Whether the new policy is the one to take: better in something, and worse in nothing that decides."""
    return any(f.kind == "better" for f in found) and not any(f.kind == "worse" and f.is_decisive for f in found)


def _figures(old: Evaluation, new: Evaluation) -> Iterator[PolicyFigure]:
    held = [e["top_speed"]["sustained_m_s"] for e in (old, new)]
    before, after = (0.0 if v is None else float(v) for v in held)
    change = _change(before, after, SPEED_SHARE * max(before, after))
    yield PolicyFigure("highest speed held", "m/s", _number(held[0]), _number(held[1]), change, is_decisive=True)
    for key, name, unit, least in (
        ("mean_forward_error_m_s", "error of forward speed", "m/s", ERROR_M_S),
        ("mean_lateral_error_m_s", "error of sideways speed", "m/s", ERROR_M_S),
        ("mean_yaw_error_rad_s", "error of turn rate", "rad/s", ERROR_RAD_S),
    ):
        a, b = _error(old, new, key), _error(new, old, key)
        if a is not None and b is not None:
            yield PolicyFigure(name, unit, _number(a), _number(b), _change(-a, -b, least))
    followed = _where_followed(old, new)
    if followed is not None:
        change = _change(-followed[0], -followed[1], LOST_M_S)
        name = "error of forward speed where the old policy follows"
        yield PolicyFigure(name, "m/s", _number(followed[0]), _number(followed[1]), change, is_decisive=True)
    still = [float(e["tracking"]["standing_speed_m_s"]) for e in (old, new)]
    change = _change(-still[0], -still[1], STANDS_M_S)
    yield PolicyFigure("speed at zero command", "m/s", _number(still[0]), _number(still[1]), change, is_decisive=True)
    work = [_work(e, other) for e, other in ((old, new), (new, old))]
    if work[0] and work[1]:
        change = _change(-work[0], -work[1], WORK_SHARE * work[0])
        yield PolicyFigure("power at the same speeds", "W", f"{work[0]:.0f}", f"{work[1]:.0f}", change)
    for key, name, count, of, is_bad in (
        ("fitted_robot", "falls, the fitted robot", "falls", "episodes", True),
        ("possible_robots", "falls, all robots that the logs allow", "falls", "episodes", True),
        ("episodes_slow", "falls in random episodes", "falls", "episodes", True),
        ("pushes", "pushes of 1 m/s survived", "survived", "trials", False),
        ("slippery_patch", "slippery patches survived", "survived", "trials", False),
    ):
        if key in old and key in new:
            counts = [(int(e[key][count]), int(e[key][of])) for e in (old, new)]
            yield _counted(name, counts[0], counts[1], is_bad=is_bad)
    gaits = [_gaits(e) for e in (old, new)]
    common = sorted(set(gaits[0]) & set(gaits[1]))
    hops = [any(g[v] in HOPS for v in common) for g in gaits]
    if common:
        old_gait, new_gait = (", ".join(dict.fromkeys(g[v] for v in common)) for g in gaits)
        change = _change(-float(hops[0]), -float(hops[1]), 0.5)
        yield PolicyFigure("gait", "", old_gait, new_gait, change, is_decisive=True)


def _change(old: float, new: float, least: float) -> Trend:
    return "better" if new > old + least else "worse" if new < old - least else "same"


def _counted(name: str, old: tuple[int, int], new: tuple[int, int], *, is_bad: bool) -> PolicyFigure:
    chance = float(fisher_exact([[old[0], old[1] - old[0]], [new[0], new[1] - new[0]]]).pvalue)
    rise = new[0] / new[1] - old[0] / old[1]
    kind: Trend = "same" if chance > CHANCE else "worse" if (rise > 0.0) == is_bad else "better"
    return PolicyFigure(name, "", f"{old[0]} of {old[1]}", f"{new[0]} of {new[1]}", kind, is_decisive=True)


def _points(own: Evaluation, other: Evaluation) -> list[Mapping[str, Any]]:
    """Points of the own tracking that the other has, too, and at which neither fell."""
    there = {tuple(p["command"]) for p in other["tracking"]["points"] if not p["fell"]}
    return [p for p in own["tracking"]["points"] if not p["fell"] and tuple(p["command"]) in there]


AXES: Final = {"mean_forward_error_m_s": 0, "mean_lateral_error_m_s": 1, "mean_yaw_error_rad_s": 2}


def _error(own: Evaluation, other: Evaluation, key: str) -> float | None:
    """Mean error along an axis over commands that both know."""
    axis = AXES[key]
    errors = [p["error"][axis] for p in _points(own, other) if p["error"][axis] is not None]
    return sum(errors) / len(errors) if errors else None


def _where_followed(old: Evaluation, new: Evaluation) -> tuple[float, float] | None:
    """Mean errors of forward speed, m/s, over the commands that the old policy follows; what falls counts 1 m/s."""
    before = {tuple(p["command"]): p["error"][0] for p in old["tracking"]["points"] if not p["fell"]}
    kept = {command for command, error in before.items() if error is not None and error <= FOLLOWS_M_S}
    after = {tuple(p["command"]): p for p in new["tracking"]["points"] if tuple(p["command"]) in kept}
    if not after:
        return None
    lost = [1.0 if p["fell"] or p["error"][0] is None else float(p["error"][0]) for p in after.values()]
    return sum(before[c] for c in after) / len(after), sum(lost) / len(lost)


def _work(own: Evaluation, other: Evaluation) -> float | None:
    """Mean power over the forward commands that both know, W."""
    power = [p["power_w"] for p in _points(own, other) if p["command"][0] > 0.0 and p["command"][1:] == [0.0, 0.0]]
    return sum(power) / len(power) if power else None


def _gaits(evaluation: Evaluation) -> dict[float, str]:
    """Name of the gait by forward command, m/s, from 0.5 m/s on."""
    points = [p for p in evaluation["tracking"]["points"] if p["command"][1:] == [0.0, 0.0] and p["command"][0] >= 0.5]
    return {float(p["command"][0]): "fall" if p["fell"] else str(p.get("gait") or "none") for p in points}


def _number(value: float | None) -> str:
    return "falls" if value is None else f"{value:.3g}"
