"""Reads a run's folders back and checks them: one protocol, whole ledgers, seals that hold, unchanged verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from spot_model.errors import BadInputError, SpotRlError
from withheld.blind.execution import NO_VERDICT
from withheld.blind.run_folder import SEED_FILE, RunHead, load_head, load_secret
from withheld.blind.seal import LEDGER, LedgerError, Seal, SealError, file_digest, read_case_ledger, read_ledger
from withheld.cases import draw
from withheld.outcome import Outcome, read_outcome
from withheld.realities.source import source_of


@dataclass(frozen=True)
class Checked:
    """A run as it may be scored."""

    head: RunHead
    outcomes: tuple[Outcome, ...]
    folders: dict[int, Path]
    """Of each case."""
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
