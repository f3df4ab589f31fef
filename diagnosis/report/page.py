"""One self-contained page of a diagnosis: opens from disk, needs no network."""

from __future__ import annotations

import html
from collections.abc import Iterable
from typing import Final

from diagnosis.diagnose import Diagnosis
from diagnosis.report import figures
from diagnosis.report.spot_picture import picture
from diagnosis.seam import CHANNEL_TITLES
from diagnosis.terminal import WORDS, joints_in_short
from diagnosis.verdict import FoundEffect, Verdict
from spot_model.facts import JOINT_NAMES

MAX_STRETCHES: Final = 60
STYLE: Final = """
body { font: 15px/1.45 system-ui, sans-serif; color: #26313b; background: #f4f6f8; margin: 0; }
main { max-width: 1320px; margin: 0 auto; padding: 20px; }
h1 { font-size: 24px; margin: 4px 0 2px; } h2 { font-size: 18px; margin: 0 0 6px; }
h3 { font-size: 15px; margin: 10px 0 2px; }
section { background: #fff; border: 1px solid #dde3e8; border-radius: 8px; padding: 14px 18px; margin: 14px 0; }
.two { display: grid; grid-template-columns: 1fr 1fr; gap: 14px; } .two section { margin: 0; }
p.note { color: #61707d; margin: 0 0 6px; font-size: 13px; } p.verdict { font-size: 19px; margin: 4px 0; }
table { border-collapse: collapse; width: 100%; font-size: 14px; }
td, th { text-align: left; vertical-align: top; padding: 3px 12px 3px 0; border-bottom: 1px solid #edf0f3; }
th { color: #61707d; font-weight: 500; } code { background: #eef2f5; padding: 1px 4px; border-radius: 4px; }
@media (max-width: 900px) { .two { grid-template-columns: 1fr; } }
"""


def page(result: Diagnosis) -> str:
    """The page as text.

    Args:
        result: The diagnosis.
    """
    from plotly.offline import get_plotlyjs

    v = result.verdict
    cells = result.map.cells if result.map is not None else ()
    named = frozenset(j for e in v.effects for j in e.joints) | frozenset(v.unknown.joints if v.unknown else ())
    joints = result.board.robot.joint_names
    gaps = _by_joint(result)
    body = [
        f"<h1>Diagnosis of {len(v.logs)} logs</h1><p class='note'>nominal model: {_e(v.nominal or 'given')}</p>",
        f"<section><p class='verdict'>{_e(WORDS[v.status])}</p>{_effects(v)}</section>",
        "<div class='two'>",
        _section("Where", "Colour: the gap of the load's error over its floor. Ring: the verdict names the joint.",
                 picture(gaps, named) if tuple(joints) == JOINT_NAMES else ""),
        _section("Which", "Red: found. Orange: not to be told apart from it with these logs.", figures.ranking(v)),
        "</div>",
    ]  # fmt: skip
    if cells:
        body.append(_section("Gap map", "Real against the nominal model in closed loop. Hover for figures. " + (
            "Colour: gap over the real-versus-real floor." if any(c.ratio is not None for c in cells) else
            "No sequence was repeated: no floor and no p-value."), figures.heat_map(cells, joints)))  # fmt: skip
    body.append(_traces(result, gaps, named))
    if v.shrink is not None:
        body.append(_section("How far the gap shrinks", _shrink_text(v), figures.shrink_bars(v)))
    if v.unknown is not None and v.unknown.curves:
        body.append(_section("What is left", f"At {', '.join(v.unknown.joints)}, largest when {v.unknown.regime}; "
                             f"{100 * v.unknown.predictable_share:.0f} % of it is predictable from signals.",
                             figures.unknown_curves(v.unknown)))  # fmt: skip
    body.append(
        _section(
            "Limits of these logs, and what to record next", "", _list(v.log_advice) + _channels(v) + _invisible(v)
        )
    )
    body.append(_section("Stretches", "Cut out, or carrying much of the gap.", _stretches(v)))
    if v.notes:
        body.append(_section("Notes", "", _list(v.notes)))
    return (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'><title>Diagnosis</title>"
        "<link rel='icon' href='data:,'>"
        f"<style>{STYLE}</style><script>{get_plotlyjs()}</script></head>"
        f"<body><main>{''.join(body)}</main></body></html>"
    )


def _e(text: object) -> str:
    return html.escape(str(text))


def _section(title: str, note: str, content: str) -> str:
    return f"<section><h2>{_e(title)}</h2><p class='note'>{_e(note)}</p>{content}</section>"


def _list(items: Iterable[str]) -> str:
    return "<ul>" + "".join(f"<li>{_e(i)}</li>" for i in items) + "</ul>"


def _by_joint(result: Diagnosis) -> dict[str, float]:
    """The gap that colours a joint: over all regimes, of the load's error, else the load, else the velocity."""
    cells = result.map.cells if result.map is not None else ()
    for signal in ("load error", "load", "velocity"):
        found = {
            c.joint: (c.ratio if c.ratio is not None else c.gap)
            for c in cells
            if c.signal == signal and c.regime == "all"
        }
        if found:
            return found
    return {}


def _effects(v: Verdict) -> str:
    if not v.effects:
        return f"<p>Probability of none {v.probability_none:.2f}, of an unknown effect {v.probability_unknown:.2f}.</p>"
    return "".join(_effect(e) for e in v.effects)


def _effect(e: FoundEffect) -> str:
    rows = "".join(
        f"<tr><th>{_e(n)}</th><td>{p.value:.4g} {_e(p.unit)}</td><td>90 %: {p.low:.4g} to {p.high:.4g}</td></tr>"
        for n, p in e.parameters.items()
    )
    group = ""
    if len(e.group) > 1 and e.split is not None:
        hand = f" Besides: {_e(e.split.by_hand)}." if e.split.by_hand else ""
        group = (
            f"<p>These logs cannot rule out {_e(', '.join(e.group[1:]))} (within {e.margin_nats:.0f} nats). "
            f"{_e(e.split_by)}{hand}<br><code>{_e(e.split.command)}</code></p>"
        )
    channels = ", ".join(
        f"{CHANNEL_TITLES.get(c, c)} {g:.0f}" for c, g in sorted(e.channels.items(), key=lambda x: -x[1])
    )
    return (
        f"<h3>{_e(e.title or e.name)} ({_e(e.name)}), probability {e.probability:.2f}, "
        f"at {_e(joints_in_short(e.joints))}</h3>"
        f"<table>{rows}</table>{group}<p class='note'>Evidence in nats by channel: {_e(channels)}</p>"
    )


def _shrink_text(v: Verdict) -> str:
    s = v.shrink
    if s is None:
        return ""
    held = f"Held-out sequences: {', '.join(s.held_out)}. " if s.held_out else ""
    if s.s is None or s.s_low is None or s.s_high is None:
        return held + "The gap does not exceed its floor."
    text = f"{held}S = {s.s:.2f}, 90 % interval {s.s_low:.2f} to {s.s_high:.2f}."
    return text + (f" Best wrong effect, {s.placebo.name}: S = {s.placebo.s:.2f}." if s.placebo else "")


def _traces(result: Diagnosis, gaps: dict[str, float], named: frozenset[str]) -> str:
    m = result.measured
    joints = result.board.robot.joint_names
    if m is None or not m.nominal:
        return ""
    pool = named or frozenset(joints)
    joint = max((j for j in joints if j in pool), key=lambda j: gaps.get(j, 0.0))
    real = result.runs[0]
    key = (real.header.command_sequence or "unnamed", real.header.repeat)
    same = [next((r for r in group if (r.header.command_sequence, r.header.repeat) == key), None)
            for group in (m.nominal, m.corrected)]  # fmt: skip
    where = f"{joint} in {real.header.command_sequence}, repeat {real.header.repeat}"
    note = f"{where}; each in closed loop, so steps drift apart."
    return _section("Traces", note, figures.traces(real, same[0], same[1], joints.index(joint)))


def _channels(v: Verdict) -> str:
    rows = "".join(
        f"<tr><th>{_e(c)}</th><td>{_e(CHANNEL_TITLES.get(c, c))}</td><td>{_e(s)}</td></tr>"
        for c, s in v.channels.items()
    )
    return f"<h3>Channels</h3><table>{rows}</table>"


def _invisible(v: Verdict) -> str:
    return f"<p>Invisible in these logs: {_e(', '.join(v.invisible))}.</p>" if v.invisible else ""


def _stretches(v: Verdict) -> str:
    rows = "".join(
        f"<tr><td>{_e(s.log)}</td><td>{s.start_s:.1f} to {s.end_s:.1f} s</td><td>{_e(s.kind)}</td>"
        f"<td>{_e(s.reason)}</td></tr>"
        for s in v.timeline[:MAX_STRETCHES]
    )
    more = len(v.timeline) - MAX_STRETCHES
    return f"<table>{rows}</table>" + (f"<p class='note'>and {more} more, in verdict.json</p>" if more > 0 else "")
