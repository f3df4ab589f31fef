"""No sentence of page, terminal or headline is false by a figure of the same verdict: both are read, and compared."""

from __future__ import annotations

import html
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple, get_args

import numpy as np
import pytest

from diagnosis.document import (
    CalibratedNumber,
    Calibration,
    Consequences,
    Difference,
    GapChange,
    GapLeft,
    GapName,
    Number,
    QuantityChange,
    Split,
    Status,
    UnknownEffect,
    Verdict,
)
from diagnosis.report import words
from diagnosis.report.headline import headline
from diagnosis.report.page import page
from diagnosis.terminal import twelve_lines
from diagnosis.verdict.diagnose import Diagnosis

from .report_case import a_diagnosis

N_VERDICTS = 400
N_PLANTED = 60
"""Lies of a kind that are tried."""
NEAR = 1.2
"""Times the floor that runs of a right model lie apart, as diagnosis/decision_constants.py has it."""
GAPS = dict(zip(get_args(GapName)[:3], ("N·m", "rad/s", "m/s"), strict=True))
FRICTION = ("viscous_friction", "stribeck_friction", "armature")
QUANTITIES = (
    ("top_speed", "top speed, held for 1 s", "m/s"),
    ("mean_speed", "mean forward speed", "m/s"),
    ("tracking_error", "mean error of the forward speed", "m/s"),
    ("power", "mechanical power, mean of what the joints give", "W"),
    ("lean", "largest lean of the body", "rad"),
    ("fall_share", "share of runs that fall", ""),
)


# Verdicts of all kinds, probable and absurd ones.


class Draw:
    """Figures from few values, so that equal ones, zeros and nulls are common."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def of(self, *values: Any) -> Any:
        return values[int(self.rng.integers(len(values)))]

    def size(self) -> float:
        return float(self.of(0.0, 0.1, 0.4, 0.4, 1.0, float(self.rng.exponential(2.0))))

    def interval(self) -> tuple[float | None, float | None]:
        low, high = sorted(self.rng.normal(self.of(-0.5, 0.0, 0.5), 0.4, size=2).tolist())
        low, high = min(low, 1.0), min(high, 1.0)
        return self.of((None, None), (low, high), (0.0, high), (low, max(low, 0.0)), (low, high), (0.3, 1.0))

    def gap(self, name: GapName, *, is_well: bool) -> GapChange:
        before, after, floor = self.size(), self.size(), self.size()
        low, high = self.interval()
        if is_well:
            before, low, high = after + floor + 1.0, 0.1, 0.9
        share = (
            (before - after) / (before - floor)
            if is_well
            else self.of(
                None, (before - after) / (before - floor) if before > floor else None, float(self.rng.normal())
            )
        )
        return GapChange(
            gap=name, unit=GAPS[name], before=before, after=after, floor=floor, share=share, low=low, high=high
        )

    def change(self, name: str, title: str, unit: str) -> QuantityChange:
        low, high = self.interval()
        sides: list[float | None] = [self.of(None, 0.3, *self.rng.uniform(0.0, 1.0, 3).tolist()) for _ in range(3)]
        before, after, robot = sides
        return QuantityChange(
            quantity=name, title=title, unit=unit, before=before, after=after, robot=robot, low=low, high=high
        )

    def consequences(self) -> Consequences | None:
        is_well = self.of(True, False, False)
        gaps = tuple(self.gap(name, is_well=is_well) for name in GAPS if self.of(True, True, False))
        changes = tuple(self.change(*q) for q in QUANTITIES if self.of(True, False))
        return self.of(None, *3 * (Consequences(loop=self.of("closed", "open"), gaps=gaps, changes=changes),))

    def difference(self, name: str) -> Difference:
        group = self.of((name,), (name, "armature"), (name, *FRICTION), (name, "armature", "backlash", "imu_tilt"))
        split = Split(name="slow", text="Walk slowly: it grows.", command="spot-rl collect")
        return Difference(
            name=name,
            title=words.plain_name(name),
            probability=self.of(0.5, *self.rng.uniform(0.51, 1.0, 9).tolist()),
            group=group,
            joints=self.of(("fl_kn",), ("fl_kn", "fr_kn", "hl_kn", "hr_kn")),
            split_by="Walk slowly." if len(group) > 1 else "",
            split=self.of(None, split) if len(group) > 1 else None,
            parameters={"level_nm": Number(value=self.size(), low=0.05, high=3.0, unit="N·m")},
            rivals=dict.fromkeys(group, 0.3),
            consequences=self.consequences(),
        )

    def number(self, effect: str, parameter: str, title: str, where: str) -> CalibratedNumber:
        value = float(self.of(0.0, 0.86, 1.0, self.rng.uniform(0.5, 1.5)))
        return CalibratedNumber(
            effect=effect,
            parameter=parameter,
            title=title,
            where=where,
            nominal=1.0,
            value=value,
            low=value - 0.1,
            high=value + 0.1,
            spread=self.of(0.0, 0.05),
            probability=float(self.rng.uniform()),
            stands_out=self.of(True, False),
        )

    def verdict(self) -> Verdict:
        gains = [self.number("torque_gain", "gain", "torque gain", kind) for kind in ("hx", "hy", "kn")]
        masses = [self.number("leg_mass", "scale", "mass of a leg", "fl")]
        unknown = UnknownEffect(
            joints=self.of((), ("hl_hy",)),
            regime=self.of("", "high speed"),
            channel="set_point_to_load",
            unit="N·m",
            left=self.size(),
            usual=self.size(),
        )
        kinds = {name: self.consequences() for name in ("torque_gain", "leg_mass", "ground_friction")}
        left = []
        for name, unit in GAPS.items():
            size, floor = self.size(), self.size()
            ratio = self.of(None, size / floor if floor > 0.0 else None)
            left.append(GapLeft(gap=name, unit=unit, left=size, floor=floor, ratio=ratio))
        names = self.of((), ("coulomb_friction",), ("coulomb_friction", "load_friction"))
        numbers = tuple([*gains, *masses][: self.of(0, 3, 4)])
        status = self.of(*get_args(Status))
        told = Verdict(
            status=status,
            warnings=self.of((), (), ("the corrected model leans",)),
            where=(),
            differences=tuple(self.difference(n) for n in names if status != "no_gap"),
            calibration=Calibration(
                numbers=numbers,
                consequences=self.consequences(),
                effects={name: c for name, c in kinds.items() if c is not None and self.of(True, False)},
            ),
            consequences=self.consequences(),
            remainder=tuple(g for g in left if self.of(True, False)),
            probability_none=float(self.rng.uniform()),
            probability_unknown=float(self.rng.uniform()),
            unknown=self.of(None, unknown),
            held=self.of((), ("the play of fl_kn is held at 0.05 rad",)),
            channels={},
            shrink=None,
            log_advice=self.of((), ("Record a sprint.",)),
            since=self.of("", "2026-11-19"),
        )
        return told.model_copy(update={"headline": headline(told)})


# What is said, and where.


class Said(NamedTuple):
    """A text, and the consequences that its gaps and its quantities are of."""

    place: str
    text: str
    gaps_of: tuple[Consequences | None, ...]
    changes_of: tuple[Consequences | None, ...]


WHOLE = ("Distance from the robot", "How the walk changes")
"""Sections about the corrected model as a whole."""


def all_said(v: Verdict, lines: list[str], text: str) -> Iterator[Said]:
    """The texts of a verdict, each with what it is about."""
    whole = (v.consequences or v.calibration.consequences,)
    kinds = tuple(v.calibration.effects.values())
    each = tuple(d.consequences for d in v.differences)
    yield Said("headline", v.headline, whole, each)
    rows = iter(each)
    for line in lines:
        if line.startswith("difference") and each:
            own = (next(rows),)
            yield Said("terminal", line, own, own)
        else:
            yield Said("terminal", line, whole, each)
    for section in re.split(r"<h2>", text):
        title = section.partition("</h2>")[0] if "</h2>" in section else "page"
        if title == "Differences":
            yield Said(title, _plain(section), each, each)
        else:
            own = (v.calibration.consequences, *kinds) if title == "Calibration" else whole
            about = whole if title in WHOLE else kinds if title == "Calibration" else each
            yield Said(title, _plain(section), own, about)


def _plain(text: str) -> str:
    text = re.sub(r"<script.*?</script>|<style.*?</style>", "", text, flags=re.DOTALL)
    return html.unescape(re.sub(r"<[^>]+>", " | ", text))


# What it claims.


class Claim(NamedTuple):
    """What a pattern found."""

    v: Verdict
    said: Said
    match: re.Match[str]


Check = Callable[[Claim], bool]


def _gaps(said: Said, name: str) -> list[GapChange]:
    return [g for c in said.gaps_of if c is not None for g in c.gaps if g.gap == name]


def _changes(said: Said, title: str) -> list[QuantityChange]:
    return [q for c in said.changes_of if c is not None for q in c.changes if q.title.split(",")[0] == title]


def _closes(g: GapChange) -> bool:
    is_sure = g.low is None or g.low > 0
    return g.share is not None and g.share > 0 and g.after < g.before and g.before > g.floor and is_sure


def _grows(g: GapChange) -> bool:
    return g.after > g.before and (g.high is None or g.high < 0)


def _says(size: float, told: str, unit: str) -> bool:
    value = np.degrees(size) if unit == "rad" else size
    return bool(np.isclose(value, float(told), rtol=6e-3, atol=1e-12))


def _is_zero_within(low: float | None, high: float | None) -> bool:
    return low is not None and high is not None and low <= 0.0 <= high


def _share_closes(c: Claim) -> bool:
    share, name = int(c.match[1]), c.match[2]
    return any(_closes(g) and round(100 * (g.share or 0.0)) == share for g in _gaps(c.said, name))


def _interval(c: Claim) -> bool:
    ends = (int(c.match[2]), int(c.match[3]))
    return any(
        g.low is not None and g.high is not None and (round(100 * g.low), round(100 * g.high)) == ends
        for g in _gaps(c.said, c.match[1])
    )


def _at_least(c: Claim) -> bool:
    return any(g.low is not None and round(100 * g.low) == int(c.match[2]) for g in _gaps(c.said, c.match[1]))


def _size(c: Claim) -> bool:
    sizes = [(p.value, p.low, p.high) for d in c.v.differences for p in d.parameters.values()]
    told = [float(c.match[i]) for i in (1, 2, 3)]
    return any(np.allclose(size, told, rtol=6e-3) for size in sizes)


def _is_nothing(q: QuantityChange) -> bool:
    return q.before is not None and q.after is not None and (_is_zero_within(q.low, q.high) or q.after == q.before)


def _moved(said: Said, title: str, sign: int, told: str) -> bool:
    return any(
        q.before is not None
        and q.after is not None
        and np.sign(q.after - q.before) == sign
        and _says(abs(q.after - q.before), told, q.unit)
        and not _is_zero_within(q.low, q.high)
        for q in _changes(said, title)
    )


def _falls(c: Claim) -> bool:
    said, m = c.said, c.match
    return any(
        (round(100 * (q.after or 0.0)), round(100 * (q.before or 0.0))) == (int(m[1]), int(m[2]))
        and int(m[1]) != int(m[2])
        and _is_zero_within(q.low, q.high) == bool(m[3])
        for q in _changes(said, "share of runs that fall")
    )


def _falls_alike(c: Claim) -> bool:
    said, m = c.said, c.match
    return any(
        {round(100 * (q.after or 0.0)), round(100 * (q.before or 0.0))} == {int(m[1])}
        for q in _changes(said, "share of runs that fall")
    )


def _gains(c: Claim) -> bool:
    """All gains that stand out; of a kind that closes much without one, the first."""
    v, m = c.v, c.match
    gains = [n for n in v.calibration.numbers if n.effect == "torque_gain"]
    out = [n for n in gains if n.stands_out] or (gains[:1] if m[4] else [])
    told = {m[1]: int(m[2])} | {name: int(p) for name, p in re.findall(r", ([a-z() ]+?) (-?\d+) %", m[3])}
    return told == {words.PLACES[n.where]: round(100 * n.value) for n in out}


def _much(v: Verdict) -> dict[tuple[str, str], int]:
    """Percents of a gap, by kind of number and gap, that close a third or more and are none of the differences'."""
    return {
        (effect, g.gap): round(100 * (g.share or 0.0))
        for effect, c in v.calibration.effects.items()
        for g in c.gaps
        if effect not in {d.name for d in v.differences} and _closes(g) and (g.share or 0.0) >= 1 / 3
    }


def _number(c: Claim) -> bool:
    """One that stands out; of a kind that closes much without one, the first."""
    v, m = c.v, c.match
    return any(
        (n.stands_out or m[5])
        and n.where == m[2]
        and n.title.endswith(m[1].strip().removeprefix("calibration "))
        and _says(n.value, m[3], "")
        and _says(n.nominal, m[4], "")
        for n in v.calibration.numbers
    )


def _left(c: Claim) -> bool:
    """What is left that no effect explains, beside what is usual."""
    u, m = c.v.unknown, c.match
    times = f"{u.left / u.usual:.1f}" if u is not None and u.usual > 0.0 else None
    return u is not None and _says(u.left, m[1], u.unit) and _says(u.usual, m[2], u.unit) and m[3] == times


def _whole(v: Verdict) -> tuple[GapChange, ...]:
    c = v.consequences or v.calibration.consequences
    return c.gaps if c is not None else ()


def _is_near(v: Verdict) -> bool:
    gaps = _whole(v)
    return bool(gaps) and not v.differences and all(g.before <= NEAR * g.floor for g in gaps)


def _can_train(v: Verdict) -> bool:
    gaps = _whole(v)
    return (
        not v.warnings
        and all(d.is_found for d in v.differences)
        and any(map(_closes, gaps))
        and all(g.after <= g.before for g in gaps)
    )


def _probability(c: Claim) -> bool:
    each = [p for d in c.v.differences for p in (d.probability, *d.rivals.values())]
    known = [c.v.probability_unknown, c.v.probability_none, *each]
    return any(f"{p:.2f}" == c.match[1] for p in known)


GAP = "(torque|joint motion|body motion)"
N = r"(-?[\d.]+(?:e-?\d+)?)"
CLAIMS: dict[str, Check] = {
    rf"(-?\d+) % of the {GAP} gap closes": _share_closes,
    rf"of the {GAP} gap closes \(90 % interval: (-?\d+) % to (-?\d+) %\)": _interval,
    rf"of the {GAP} gap closes \(90 % interval: at least (-?\d+) %\)": _at_least,
    rf": (?:level )?{N} N·m \({N} to {N}\), P": _size,
    r"possibly ": lambda c: any(not d.is_found for d in c.v.differences),
    rf"the {GAP} gap grows": lambda c: any(map(_grows, _gaps(c.said, c.match[1]))),
    rf"the {GAP} gap was no larger than repeats or noise explain": lambda c: any(
        g.before <= g.floor for g in _gaps(c.said, c.match[1])
    ),
    rf"the change of the {GAP} gap may be chance": lambda c: any(
        not (_closes(g) and (g.share or 0) >= 0.005) and not _grows(g) for g in _gaps(c.said, c.match[1])
    ),
    rf"slower by {N} m/s \(([a-z ]+)\)": lambda c: _moved(c.said, c.match[2], -1, c.match[1]),
    rf"faster by {N} m/s \(([a-z ]+)\)": lambda c: _moved(c.said, c.match[2], 1, c.match[1]),
    rf"the ([a-z ]+) falls by {N}": lambda c: _moved(c.said, c.match[1], -1, c.match[2]),
    rf"the ([a-z ]+) rises by {N}": lambda c: _moved(c.said, c.match[1], 1, c.match[2]),
    r"the change of the ((?!torque gap|joint motion gap|body motion gap)[a-z ]+) may be chance": lambda c: any(
        map(_is_nothing, _changes(c.said, c.match[1]))
    ),
    r"falls in (\d+) % of runs instead of (\d+) %(, which may be chance)?": _falls,
    r"falls in (\d+) % of runs, as without": _falls_alike,
    r"(sideways hips \(hx\)|forward hips \(hy\)|knees) give (-?\d+) % of the torque asked"
    r"((?:, (?!which)[a-z() ]+ -?\d+ %)*)(, which)?": _gains,
    rf"which closes (-?\d+) % of the {GAP} gap": lambda c: any(
        name == c.match[2] and share == int(c.match[1]) for (_, name), share in _much(c.v).items()
    ),
    rf"{N} N·m is left; [a-z ]+ at most {N} N·m there \(95 in 100\)(?:: {N} times as much)?": _left,
    r"something like ((?:less )?[a-z ]+?)(?: at|, P|:|;| \d| and)": lambda c: c.match[1] == "friction",
    r"one of (\d+) effects": lambda c: any(len(d.group) == int(c.match[1]) > 3 for d in c.v.differences),
    r"no number of the robot's own is known": lambda c: not c.v.calibration.numbers,
    r"no number of the robot's own stands out": lambda c: (
        bool(c.v.calibration.numbers) and not any(n.stands_out for n in c.v.calibration.numbers)
    ),
    r"; (\d+) stands? out": lambda c: int(c.match[1]) == sum(n.stands_out for n in c.v.calibration.numbers),
    r"([a-z ]+) of (\w+) is ([\d.]+), nominal ([\d.]+)(, which)?": _number,
    r"(?i:no gap): the nominal model": lambda c: _is_near(c.v) and c.v.status == "no_gap",
    r"(?i:no difference) is shown": lambda c: not c.v.differences,
    r"^difference  none": lambda c: not c.v.differences,
    rf"the {GAP} gap of the nominal model is larger than repeats or noise explain": lambda c: any(
        g.gap == c.match[1] and g.before > NEAR * g.floor for g in _whole(c.v)
    ),
    r"the corrected model is not shown to close a gap": lambda c: (
        not any(_closes(g) and (g.share or 0) >= 0.005 for g in _whole(c.v))
    ),
    rf"{GAP} {N} [^ ,;]+, {N} times what repeats or noise explain": lambda c: any(
        (g.gap, g.ratio is not None and f"{g.ratio:.1f}") == (c.match[1], c.match[3]) and _says(g.left, c.match[2], "")
        for g in c.v.remainder
    ),
    r"what is left:": lambda c: any((g.ratio or 0.0) > NEAR for g in c.v.remainder),
    r"(?<![a-z])P (\d\.\d\d)": _probability,
    r"(?i:something (?:else )?acts)": lambda c: c.v.probability_unknown > 0.5,
    r"next: train on the corrected model": lambda c: _can_train(c.v),
    r"next: train on the nominal model": lambda c: _is_near(c.v),
    r"next: read the warnings": lambda c: bool(c.v.warnings),
}


def faults(v: Verdict, lines: list[str], text: str) -> list[str]:
    """Claims that are false by a figure of the verdict."""
    found = [
        f"{said.place}: {m[0]}"
        for said in all_said(v, lines, text)
        for pattern, is_true in CLAIMS.items()
        for m in re.finditer(pattern, said.text)
        if not is_true(Claim(v, said, m))
    ]
    found += re.findall(r"\b(?:nan|None|inf)\b|-0 %", f"{v.headline} {lines} {_plain(text)}")
    parts = re.split("; next: |; ", v.headline)
    if any(p[1:] not in html.unescape(text) for p in parts) or not any(line.endswith(v.headline) for line in lines):
        found.append("the headline of page, terminal and verdict differ")
    kinds = set() if v.status in ("cannot_tell", "no_gap") else {effect for effect, _ in _much(v)}
    if v.headline.count("which closes") != min(len(kinds), words.MOST_KINDS):
        found.append("what closes a third of a gap is not in the headline")
    if v.warnings and (not lines[0].startswith("warning") or text.index("Read this first") > text.index("<h1>")):
        found.append("warnings do not come first")
    return found


@pytest.fixture(scope="module")
def bare() -> Diagnosis:
    return replace(a_diagnosis(), cells=(), simulated={})


@pytest.fixture(scope="module")
def cases(bare: Diagnosis) -> list[tuple[Verdict, list[str], str]]:
    made = [Draw(seed).verdict() for seed in range(N_VERDICTS)]
    return [(v, twelve_lines(v, {}), page(replace(bare, verdict=v))) for v in made]


def test_no_sentence_is_false_by_a_figure(cases: list[tuple[Verdict, list[str], str]]) -> None:
    assert [(i, fault) for i, case in enumerate(cases) for fault in faults(*case)] == []


def test_every_claim_is_made_and_every_status_occurs(cases: list[tuple[Verdict, list[str], str]]) -> None:
    said = [s.text for case in cases for s in all_said(*case)]
    never = [p for p in CLAIMS if not any(re.search(p, text) for text in said)]
    assert never == []
    assert {v.status for v, _, _ in cases} == set(get_args(Status))


@pytest.mark.parametrize(
    ("true", "false"),
    [
        (r"(\d+) % of the (\w+)", r"9\1 % of the \2"),
        (r"slower by", "faster by"),
        (r"faster by", "slower by"),
        (r"falls by", "rises by"),
        (r"rises by", "falls by"),
        (r"(slower|faster) by ", r"\1 by 7"),
        (r"the (torque|joint motion|body motion) gap grows", r"12 % of the \1 gap closes"),
        (r"the change of the (torque|joint motion|body motion) gap may be chance", r"71 % of the \1 gap closes"),
        (r"falls in (\d+) % of runs instead", r"falls in 1\1 % of runs instead"),
        (r"give (\d+) %", r"give 1\1 %"),
        (r"which closes (\d+) %", r"which closes 1\1 %"),
        (r"; calibration: .*?;", ";"),
        (r"([\d.]+) N·m is left;", r"7\1 N·m is left;"),
        (r"(\d) times what", r"\1\1 times what"),
        (r"next: [^<]*", "next: train on the corrected model"),
        (r"(?i)^calibration: .*;", "No gap: the nominal model is near;"),
        (r"P 0\.\d\d", "P 9.99"),
    ],
)
def test_a_false_word_is_noticed(cases: list[tuple[Verdict, list[str], str]], true: str, false: str) -> None:
    """Planted in the headline of page, terminal and verdict, and in every line of the terminal."""
    n_planted = n_noticed = 0
    for v, lines, text in cases:
        planted = [re.sub(true, false, line) for line in lines]
        headline = re.sub(true, false, v.headline)
        lied = v.model_copy(update={"headline": headline})
        said = (
            lied,
            [
                p if not o.endswith(v.headline) else o.replace(v.headline, headline)
                for p, o in zip(planted, lines, strict=True)
            ],
            text.replace(html.escape(v.headline), html.escape(headline)),
        )
        if said[1] == lines or (true.startswith("next") and _can_train(v)):
            continue
        n_planted += 1
        n_noticed += bool(faults(*said))
        if n_planted == N_PLANTED:
            break
    assert n_planted >= 5
    assert n_noticed == n_planted
