"""Logs of a robot with an arm, beside nominal models that have its weight or not."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from diagnosis import session
from diagnosis.session import WITHOUT_ARM, DiagnosisRequest, run_session


class EndError(Exception):
    """The logs are read and told of."""


class Said(list[str]):
    """What is said."""

    __call__ = list.append

    def at(self, _: float) -> None:
        """How far it is."""


@pytest.mark.parametrize(
    ("nominal", "has_arm", "is_told"),
    [("paper_identified", True, True), ("spot_with_arm", True, False), ("paper_identified", False, False)],
)
def test_a_nominal_model_that_lacks_the_arm_is_told_of(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, nominal: str, has_arm: bool, is_told: bool
) -> None:
    def end(*_: Any, **__: Any) -> None:
        raise EndError

    run = SimpleNamespace(arm=[0] * has_arm, events=(), header=SimpleNamespace(robot_id=""))
    monkeypatch.setattr(session, "read_logs", lambda *_: ((run,), ()))
    monkeypatch.setattr(session, "find_policy_file", lambda *_: None)
    monkeypatch.setattr(session, "diagnose_runs", end)
    said: Any = Said()
    with pytest.raises(EndError):
        run_session(DiagnosisRequest(logs=("a.mcap",), nominal=nominal), tmp_path, said)
    assert (f"note: {WITHOUT_ARM}" in said) is is_told
