"""Read a run's cases back and check them: one protocol, whole ledgers, seals that hold; and show one of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from spot_model.errors import BadInputError, SpotRlError
from withheld.blind.execution import NO_VERDICT
from withheld.blind.run_folder import SEED_FILE, RunHead, load_head, load_secret
from withheld.blind.seal import LEDGER, LedgerError, Seal, SealError, file_digest, read_case_ledger, read_ledger
from withheld.cases import WORDS, draw
from withheld.outcome import Outcome, Verdict, read_outcome
from withheld.plan import Fault
from withheld.realities.source import source_of
from withheld.scoring.scores import does, is_right, parameters, score


@dataclass(frozen=True)
class Checked:
    """A run as it may be scored."""

    head: RunHead
    outcomes: tuple[Outcome, ...]
    folders: dict[int, Path]
    """Folder of each case."""
    seed: int | None
    """Published; None where no folder holds it."""
    locked_in: tuple[str, ...]


def check(folders: Sequence[Path], policies: Path | None = None) -> Checked:
    """Read all cases of a run, or of its parts.

    Args:
        folders: Of one run.
        policies: Where its policies lie; with them the cases are drawn again from the seed and compared.

    Raises:
        BadInputError: The folders are of different protocols, or hold no case.
        SpotRlError: A ledger, a seal or a verdict does not hold.
    """
    heads = [load_head(folder) for folder in folders]
    for folder, head in zip(folders, heads, strict=True):
        _same(folders[0], heads[0], folder, head)
    outcomes: dict[int, Outcome] = {}
    where: dict[int, Path] = {}
    for folder in folders:
        entered = _entered(folder)
        for path in sorted((folder / "cases").glob("*/outcome.json")):
            outcome = case_of(path.parent)
            number = outcome.case.number
            if entered.get(number, end := read_ledger(path.parent / LEDGER)[-1].hash) != end:
                raise LedgerError(f"{path.parent / LEDGER} is not the one that the run's own ledger entered")
            if number in outcomes:
                raise BadInputError(f"case {number} is in {where[number]} and in {path.parent}; leave one out")
            outcomes[number], where[number] = outcome, path.parent
    if not outcomes:
        raise BadInputError(f"{', '.join(str(f) for f in folders)}: no finished case; run or resume first")
    seeds = {load_secret(f, h).seed for f, h in zip(folders, heads, strict=True) if (f / SEED_FILE).exists()}
    if len(seeds) > 1:
        raise BadInputError("the folders were drawn from different seeds; score each by itself")
    seed = next(iter(seeds), None)
    ordered = tuple(outcomes[n] for n in sorted(outcomes))
    if seed is not None and policies is not None and policies.is_dir():
        _drawn_again(ordered, seed, heads[0], policies)
    return Checked(heads[0], ordered, where, seed, tuple(sorted({o.locked_in for o in ordered})))


def _entered(folder: Path) -> dict[int, str]:
    """By case, the hash with which its ledger ended, from the run's own ledger."""
    path = folder / LEDGER
    entries = read_ledger(path) if path.exists() else []
    return {e.data["case"]: e.data["ledger"] for e in entries if e.event == "case"}


def _same(first: Path, one: RunHead, second: Path, other: RunHead) -> None:
    for name in ("protocol", "generator", "policies", "reality", "cases", "is_quick"):
        if getattr(one, name) != getattr(other, name):
            raise BadInputError(f"{first} and {second} differ in {name}; only parts of one run are scored together")


def case_of(folder: Path) -> Outcome:
    """One case, checked.

    Raises:
        BadInputError: It does not follow the schema.
        SpotRlError: Its ledger, seal or verdict does not hold.
    """
    outcome = read_outcome(folder / "outcome.json")
    events = read_case_ledger(folder / LEDGER)
    end = events["opened"].data
    truth = Seal(end["nonce"], end["text"]).opened(events["sealed"].data["truth"])
    if truth != outcome.truth or outcome.seal != events["sealed"].data["truth"]:
        raise SealError(f"{folder / 'outcome.json'}: its truth is not the one that was sealed")
    verdict = folder / "verdict.json"
    found = file_digest(verdict) if verdict.exists() else NO_VERDICT
    if not found == events["verdict"].data["verdict"] == outcome.verdict_sha256:
        raise SealError(f"{verdict}: its digest is {found}, not the one taken before the seal was opened")
    return outcome


def _drawn_again(outcomes: Sequence[Outcome], seed: int, head: RunHead, policies: Path) -> None:
    try:
        source = source_of(head.reality)
    except BadInputError:
        return
    for outcome in outcomes:
        case = outcome.case
        if draw(seed, case.number, source, policies, head.is_quick, case.attempt) != case:
            raise SpotRlError(f"case {case.number} is not the one that seed {seed} draws with these sources")


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
