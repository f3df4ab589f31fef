"""A seal holds only for what was sealed; a ledger shows any change and any wrong order."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from withheld.blind.seal import LedgerError, Seal, SealError, enter, read_case_ledger, read_ledger
from withheld.plan import Fault, Truth

TRUTH = Truth(faults=(Fault(names=("torque_gain",), joints=("fl_kn",), family="drive", size=0.4),))


def test_a_seal_opens_to_what_was_sealed_and_hides_it() -> None:
    seal = Seal.of(TRUTH)
    assert seal.opened(seal.digest) == TRUTH
    assert len({Seal.of(TRUTH).digest for _ in range(20)}) == 20


def test_what_was_changed_does_not_open() -> None:
    seal = Seal.of(TRUTH)
    changed = (replace(seal, nonce="00" + seal.nonce[2:]), replace(seal, text=seal.text.replace("fl_kn", "fr_kn")))
    for other in changed:
        assert other != seal
        with pytest.raises(SealError, match="changed after the verdict"):
            other.opened(seal.digest)


def _ledger(path: Path, *events: str) -> Path:
    for event in events:
        enter(path, event, case=3)
    return path


def test_a_ledger_is_a_chain(tmp_path: Path) -> None:
    path = _ledger(tmp_path / "l.jsonl", "sealed", "verdict", "opened")
    entries = read_ledger(path)
    assert [e.previous for e in entries[1:]] == [e.hash for e in entries[:-1]]
    assert list(read_case_ledger(path)) == ["sealed", "verdict", "opened"]


@pytest.mark.parametrize("change", ["edit", "drop", "swap", "cut"])
def test_a_changed_ledger_is_refused(tmp_path: Path, change: str) -> None:
    path = _ledger(tmp_path / "l.jsonl", "sealed", "verdict", "opened")
    rows = path.read_text().splitlines()
    if change == "edit":
        rows[1] = rows[1].replace('"case": 3', '"case": 4')
        assert json.loads(rows[1])["data"] == {"case": 4}
    elif change == "drop":
        del rows[0]
    elif change == "swap":
        rows[:2] = rows[1::-1]
    else:
        rows[1] = rows[1][:-9]
    path.write_text("\n".join(rows) + "\n")
    with pytest.raises(LedgerError, match=r"line [12]: (its hash does not follow|no entry)"):
        read_ledger(path)


@pytest.mark.parametrize("events", [("verdict", "sealed", "opened"), ("sealed", "opened"), ("sealed", "verdict")])
def test_an_order_that_proves_nothing_is_refused(tmp_path: Path, events: tuple[str, ...]) -> None:
    with pytest.raises(LedgerError, match="in this order"):
        read_case_ledger(_ledger(tmp_path / "l.jsonl", *events))
