"""Every command of the pages is run by a test, or stands in the ledger with the reason why not."""

from __future__ import annotations

import pytest

from . import test_apart, test_from_a_wheel, test_in_a_clone, test_installing
from .blocks import PAGES, REPOSITORY, all_blocks, is_to_be_run, spans_of
from .ledger import BY_CI, ELSEWHERE, FORMS, NOT_RUN, RUN_APART
from .scripts import LEDGER as SCRIPTS
from .scripts import SCRIPT

MARKED = ("run", "play", "session", "gpu")
"""Orders of blocks whose commands ``test_docs.py`` runs."""

IN_BLOCKS = {
    " ".join(words): block.order.partition(" ")[0]
    for block in sorted(all_blocks(), key=lambda block: block.order in MARKED)
    if block.language in ("sh", "")
    for words in block.commands
}
IN_SENTENCES = {" ".join(words) for page in PAGES for words in spans_of(page) if is_to_be_run(words)}
OF_SCRIPTS = {
    command for command in IN_BLOCKS.keys() | IN_SENTENCES if (found := SCRIPT.search(command)) and found[0] in SCRIPTS
}
"""Commands of scripts that ``test_scripts.py`` knows."""
RUN = {command for command, order in IN_BLOCKS.items() if order in MARKED} | OF_SCRIPTS
LEDGER = {**RUN_APART, **dict.fromkeys(BY_CI, ".ci/run"), **ELSEWHERE, **FORMS, **NOT_RUN}


def test_every_command_is_run_or_has_its_reason() -> None:
    missing = sorted((IN_BLOCKS.keys() | IN_SENTENCES) - RUN - LEDGER.keys())
    assert not missing, "neither run by a test nor in tests/docs/ledger.py with a reason:\n" + "\n".join(missing)


def test_the_ledger_names_nothing_that_no_page_has() -> None:
    assert not LEDGER.keys() - IN_BLOCKS.keys() - IN_SENTENCES
    assert not NOT_RUN.keys() & (RUN | RUN_APART.keys()), "what is run needs no reason"


def test_a_command_that_nobody_runs_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(IN_BLOCKS, "spot-rl ctl status --once-more", "")
    with pytest.raises(AssertionError, match="--once-more"):
        test_every_command_is_run_or_has_its_reason()


def test_what_is_run_elsewhere_is_there() -> None:
    steps = (REPOSITORY / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    assert set(BY_CI) <= set(steps)
    for command, (file, words) in ELSEWHERE.items():
        assert words in (REPOSITORY / "tests" / file).read_text(encoding="utf-8"), command
    for command, beginning in FORMS.items():
        assert any(other.startswith(beginning) or beginning in other for other in RUN | RUN_APART.keys()), command
    tests = {
        name for module in (test_apart, test_from_a_wheel, test_in_a_clone, test_installing) for name in vars(module)
    }
    assert set(RUN_APART.values()) <= tests


def test_what_needs_systemd_is_tried_by_the_script() -> None:
    trial = (REPOSITORY / "scripts" / "try_systemd.py").read_text(encoding="utf-8")
    for verb in ("start", "stop", "enable"):
        assert f'"systemctl", "{verb}"' in trial, verb
