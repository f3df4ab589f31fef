"""Ctrl-C in a training."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from trainer.ppo import training_log
from trainer.ppo.training_log import StopRequest, TrainingInterruptedError, TrainingLog


def test_the_first_signal_is_a_request_and_the_second_acts_as_before() -> None:
    request = StopRequest()
    with request.listening():
        os.kill(os.getpid(), signal.SIGINT)
        assert request.is_made
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_request_saves_at_once_and_says_how_to_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    saved: list[int] = []
    monkeypatch.setattr(training_log, "save_checkpoint", lambda *words: saved.append(words[2]))
    env: Any = SimpleNamespace()
    log = TrainingLog(tmp_path, env, save_every=50, total_iterations=100, steps_per_iteration=1)
    runner: Any = None
    log.checkpoint(runner, 5)
    assert saved == []
    log.stop_request.is_made = True
    with pytest.raises(TrainingInterruptedError, match=r"iteration 7 of 100.*--resume"):
        log.checkpoint(runner, 6)
    assert saved == [7]
