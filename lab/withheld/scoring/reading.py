"""Read the cases of a run, or of its parts, and show one of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from spot_model.errors import BadInputError
from withheld.blind.run_folder import CASES, RunHead, load_head
from withheld.cases import WORDS
from withheld.outcome import Outcome, Verdict, read_outcome
from withheld.plan import Fault
from withheld.scoring.scores import does, is_right, parameters, score


@dataclass(frozen=True)
class Cases:
    """A run as it may be scored."""

    head: RunHead
    outcomes: tuple[Outcome, ...]
    folders: dict[int, Path]
    """Folder of each case."""


def read_cases(folders: Sequence[Path]) -> Cases:
    """Read all cases of a run, or of its parts.

    Raises:
        BadInputError: The folders are of different runs, or hold no case, or one twice.
    """
    heads = [load_head(folder) for folder in folders]
    for folder, head in zip(folders, heads, strict=True):
        _same(folders[0], heads[0], folder, head)
    outcomes: dict[int, Outcome] = {}
    where: dict[int, Path] = {}
    for folder in folders:
        for path in sorted((folder / CASES).glob("*/outcome.json")):
            outcome = read_outcome(path)
            number = outcome.case.number
            if number in outcomes:
                raise BadInputError(f"case {number} is in {where[number]} and in {path.parent}; leave one out")
            outcomes[number], where[number] = outcome, path.parent
    if not outcomes:
        raise BadInputError(f"{', '.join(str(f) for f in folders)}: no finished case; run or resume first")
    # The part that drew the seed speaks for those to which it was given.
    head = next((head for head in heads if head.is_seed_drawn), heads[0])
    return Cases(head, tuple(outcomes[n] for n in sorted(outcomes)), where)


def _same(first: Path, one: RunHead, second: Path, other: RunHead) -> None:
    for name in ("digest", "seed", "reality", "cases", "is_quick"):
        if getattr(one, name) != getattr(other, name):
            raise BadInputError(f"{first} and {second} differ in {name}; only parts of one run are scored together")


def folder_of(path: Path) -> Path:
    """The case's folder, from it, its number under a run's folder, or its file.

    Raises:
        BadInputError: There is no such case.
    """
    for folder in (path, path.parent, path.parent / CASES / path.name.zfill(4)):
        if (folder / "outcome.json").is_file():
            return folder
    raise BadInputError(f"{path} is no case; give DIR/NUMBER, a folder under DIR/cases, or its outcome.json")


def show_case(path: Path) -> list[str]:
    """Lines.

    Raises:
        BadInputError: There is no such case.
    """
    folder = folder_of(path)
    o = read_outcome(folder / "outcome.json")
    made = [f"case {o.case.number}: {WORDS[o.case.kind]}"]
    made.append(f"without {', '.join(o.case.without) or 'nothing'} in the library")
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
