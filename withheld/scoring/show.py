"""One case for a terminal: what was hidden, what was said, what it scores, and that its seal holds."""

from __future__ import annotations

from pathlib import Path

from spot_model.errors import BadInputError
from withheld.cases.draw import WORDS
from withheld.plan import Fault
from withheld.scoring.outcome import Outcome, load_outcome
from withheld.scoring.scores import is_foreign, is_large, parameters, score
from withheld.scoring.verify import case_of


def folder_of(path: Path) -> Path:
    """The case's folder, from it, its number under a run's folder, or its file.

    Raises:
        BadInputError: There is no such case.
    """
    for folder in (path, path.parent, path.parent / "cases" / path.name.zfill(4)):
        if (folder / "outcome.json").is_file():
            return folder
    raise BadInputError(f"{path} is no case; give DIR/NUMBER, a folder under DIR/cases, or its outcome.json")


def show_case(path: Path) -> list[str]:
    """Lines.

    Raises:
        BadInputError: There is no such case.
        SpotRlError: Its seal or its ledger does not hold.
    """
    folder = folder_of(path)
    case_of(folder)
    o = load_outcome(folder / "outcome.json")
    made = [f"case {o.case.number}: {WORDS[o.case.kind]}"]
    made.append(f"seal    {o.seal} holds; verdict {o.verdict_sha256[:16]} was hashed before it was opened")
    made.append(f"locked  {o.locked_in}; left out of the library: {', '.join(o.case.without) or 'nothing'}")
    lacks = f", without {', '.join(o.case.missing)}" if o.case.missing else ""
    made.append(f"logs    policy {o.case.policy}, {len(o.case.sequences)} sequences x {o.case.repeats} runs{lacks}")
    made += [f"hidden  {fault_words(f)}" for f in o.truth.faults] or ["hidden  nothing"]
    if o.moved is not None:
        made.append(f"        moves the headline gap by {o.moved:.1f} times its floor")
    made.append(f"said    {o.status}; none {o.probability_none:.2f}, unknown {o.probability_unknown:.2f}")
    for e in o.effects:
        made.append(f"        {e.name} {e.probability:.2f}, group {', '.join(e.group)}, at {', '.join(e.joints)}")
        made += [
            f"          {n} = {v.value:.4g} ({v.low:.4g} to {v.high:.4g}) {v.unit}" for n, v in e.parameters.items()
        ]
    made += [f"        {h.name}: true {h.true:.4g}, off by {100 * h.error:.0f} %" for h in parameters(o)]
    if o.shrink is not None and o.shrink.s is not None:
        low, high = o.shrink.low or 0.0, o.shrink.high or 0.0
        true = "" if o.shrink.true_s is None else f"; true S {o.shrink.true_s:.2f}"
        made.append(f"shrink  S {o.shrink.s:.2f} ({low:.2f} to {high:.2f}){true}")
    made.append(f"scored  {verdict_words(o)}")
    for name, answer in o.baselines.items():
        gap = f"{answer.effect or 'a gap'} at {', '.join(answer.joints)}" if answer.has_gap else "no gap"
        made.append(f"beside  {name}: {gap}")
    report = folder / "report.html"
    return [*made, f"report  {report}"] if report.exists() else made


def fault_words(f: Fault) -> str:
    """A fault in words."""
    names = ", ".join(f.names) or "no effect of the library"
    numbers = ", ".join(f"{n} {v:.4g}" for n, v in f.parameters.items())
    at = f" at {', '.join(f.joints)}" if f.joints else ""
    return f"{f.kind or f.family}: {names}{at}, size {f.size:g}{'; ' + numbers if numbers else ''}"


def verdict_words(o: Outcome) -> str:
    """Right or wrong, in words."""
    s = score(o)
    if o.status == "failed":
        return f"wrong: no verdict ({o.problem})"
    if s.false_alarm is not None:
        return "wrong: a false alarm" if s.false_alarm else "right: no effect"
    if is_foreign(o):
        if s.unknown:
            return "right: unknown" + ("" if s.unknown_joints is not False else ", at other joints")
        return "wrong: called no gap" if s.missed else "wrong: named an effect that it is not"
    size = "" if is_large(o) else "; a small effect"
    if s.missed:
        return f"wrong: called no gap{size}"
    if s.group:
        return f"right{'' if s.top1 else ', in a group'}{size}"
    if s.first:
        return f"wrong: not called explained by it alone, but it is listed first{size}"
    return f"wrong: {s.found} of {len(o.truth.faults)} named{size}"
