"""A seal holds only for what was sealed; a ledger shows any change and any wrong order."""

import json
from pathlib import Path

import pytest

from withheld.blind.ledger import Ledger, LedgerError, check_order, read_ledger
from withheld.blind.seal import Seal, SealError, digest_of, opened
from withheld.plan import Fault, Truth

TRUTH = Truth(faults=(Fault(names=("torque_gain",), joints=("fl_kn",), family="drive", size=0.4),))


def test_a_seal_opens_to_what_was_sealed() -> None:
    seal = Seal.of(TRUTH)
    assert opened(seal.digest, seal.nonce, seal.text) == TRUTH
    assert seal.digest == digest_of(seal.nonce, seal.text)


def test_equal_truths_have_different_digests() -> None:
    assert len({Seal.of(Truth(faults=())).digest for _ in range(20)}) == 20


@pytest.mark.parametrize("part", ["nonce", "text"])
def test_what_was_changed_does_not_open(part: str) -> None:
    seal = Seal.of(TRUTH)
    nonce = "00" + seal.nonce[2:] if part == "nonce" else seal.nonce
    text = seal.text.replace("fl_kn", "fr_kn") if part == "text" else seal.text
    assert (nonce, text) != (seal.nonce, seal.text)
    with pytest.raises(SealError, match="changed after the verdict"):
        opened(seal.digest, nonce, text)


def _ledger(path: Path, *events: str) -> Path:
    ledger = Ledger(path)
    for event in events:
        ledger.add(event, case=3)
    return path


def test_a_ledger_goes_on_where_it_ended(tmp_path: Path) -> None:
    path = _ledger(tmp_path / "l.jsonl", "sealed")
    _ledger(path, "verdict", "opened")
    entries = read_ledger(path)
    assert [e.previous for e in entries[1:]] == [e.hash for e in entries[:-1]]
    assert set(check_order(entries, path)) == {"sealed", "verdict", "opened"}


@pytest.mark.parametrize("change", ["edit", "drop", "swap"])
def test_a_changed_ledger_is_refused(tmp_path: Path, change: str) -> None:
    path = _ledger(tmp_path / "l.jsonl", "sealed", "verdict", "opened")
    rows = path.read_text().splitlines()
    if change == "edit":
        line = json.loads(rows[1])
        line["data"]["case"] = 4
        rows[1] = json.dumps(line)
    elif change == "drop":
        del rows[0]
    else:
        rows[0], rows[1] = rows[1], rows[0]
    path.write_text("\n".join(rows) + "\n")
    with pytest.raises(LedgerError, match=r"line [12]: its hash does not follow"):
        read_ledger(path)


@pytest.mark.parametrize("events", [("verdict", "sealed", "opened"), ("sealed", "opened"), ("sealed", "verdict")])
def test_an_order_that_proves_nothing_is_refused(tmp_path: Path, events: tuple[str, ...]) -> None:
    path = _ledger(tmp_path / "l.jsonl", *events)
    with pytest.raises(LedgerError, match="in this order"):
        check_order(read_ledger(path), path)
