"""One case for a terminal: what was hidden, what was said, what it scores, and that its seal holds."""

from __future__ import annotations

from pathlib import Path

from spot_model.errors import BadInputError
from withheld.cases import WORDS
from withheld.outcome import Outcome, Verdict, read_outcome
from withheld.plan import Fault
from withheld.scoring.scores import is_right, parameters, score
from withheld.scoring.sizes import does
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
    o = read_outcome(folder / "outcome.json")
    made = [f"case {o.case.number}: {WORDS[o.case.kind]}"]
    made.append(f"seal    {o.seal} holds; verdict {o.verdict_sha256[:16]} was hashed before it was opened")
    made.append(f"locked  {o.locked_in}; left out of the library: {', '.join(o.case.without) or 'nothing'}")
    lacks = f", without {', '.join(o.case.missing)}" if o.case.missing else ""
    made.append(f"logs    policy {o.case.policy}, {len(o.case.sequences)} sequences x {o.case.repeats} runs{lacks}")
    made += [f"hidden  {fault_words(f)}" for f in o.truth.faults] or ["hidden  nothing"]
    scale = f"{o.truth.error_scale:.2g} times the usual"
    made.append(f"errors  {scale}")
    made += [f"        fault {i + 1}: {does(o, i)}" for i in range(len(o.truth.faults))]
    made += _said(o.verdict)
    made += [f"        {h.name}: true {h.true:.4g}, off by {100 * h.error:.0f} %" for h in parameters(o)]
    made.append(f"scored  {verdict_words(o)}")
    report = folder / "report.html"
    return [*made, f"report  {report}"] if report.exists() else made


def fault_words(f: Fault) -> str:
    """A fault in words."""
    names = ", ".join(f.names) or "no effect of the library"
    numbers = ", ".join(f"{n} {v:.4g}" for n, v in f.parameters.items())
    at = f" at {', '.join(f.joints)}" if f.joints else ""
    return f"{f.kind or f.family}: {names}{at}, size {f.size:.2g}{'; ' + numbers if numbers else ''}"


def verdict_words(o: Outcome) -> str:
    """Right or wrong, in words."""
    if o.verdict is None:
        return f"wrong: no verdict ({o.problem})"
    s, right = score(o), is_right(o)
    said = (
        f"{len(s.named)} of {len(o.truth.faults)} named, {s.n_wrong} wrong"
        if o.verdict.differences
        else "nothing named"
    )
    said += ", something called unknown" if s.is_unknown else ""
    return f"{'not asked' if right is None else 'right' if right else 'wrong'}: {said}"


def _said(verdict: Verdict | None) -> list[str]:
    if verdict is None:
        return ["said    nothing: it ended without a verdict"]
    v = verdict
    made = [f"said    {v.status}; none {v.probability_none:.2f}, unknown {v.probability_unknown:.2f}"]
    for d in v.differences:
        made.append(f"        {d.name} {d.probability:.2f}, group {', '.join(d.group)}, at {', '.join(d.joints)}")
        for where, own in {"": d.parameters, **d.by_type}.items():
            made += [f"          {where} {n} = {x.value:.4g} ({x.low:.4g} to {x.high:.4g})" for n, x in own.items()]
        changes = d.consequences.changes if d.consequences is not None else ()
        told = ((c.quantity, c.before, c.after) for c in changes)
        made += [f"          {name}: {a:.3g} to {b:.3g}" for name, a, b in told if a is not None and b is not None]
    numbers = [n for n in v.calibration.numbers if n.stands_out]
    return [
        *made,
        *(f"        calibration: {n.title} at {n.where} {n.value:.4g}, not {n.nominal:.4g}" for n in numbers),
    ]
