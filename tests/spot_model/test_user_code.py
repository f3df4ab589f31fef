"""Code of users that cannot be loaded, or that raises: told as theirs, with file and line, wherever it is named."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from diagnosis.library.registry import chosen_library
from spot_model.console.command_line import main
from spot_model.effects.registry import effect_class
from spot_model.errors import BadInputError
from spot_runtime.config import RunConfig
from spot_runtime.hal.registry import HalRequest, find_adapter
from trainer.task.rewards import reward_term
from withheld.realities.source import source_of

BROKEN = {
    "syntax": ("def half(:\n", r"line 1"),
    "raises": ("\n1 / 0\n", r"ZeroDivisionError: division by zero \(.*broken_raises.py, line 2\)"),
    "leaves": ("import sys\nsys.exit('usage: broken')\n", r"SystemExit: usage: broken"),
    "misses": ("import no_such_library\n", r"No module named 'no_such_library'"),
    "name": ("Other = 1\n", r"has no attribute 'Thing'"),
}


def adapter(name: str) -> object:
    return find_adapter(HalRequest("HOST", RunConfig.model_validate({"robot": {"hal": name}})))


LOADERS: dict[str, Callable[[str], object]] = {
    "effect": effect_class,
    "--add-effect": lambda name: chosen_library([name], []),
    "HAL adapter": adapter,
    "reward": reward_term,
    "--reality": source_of,
}


@pytest.mark.parametrize("kind", BROKEN)
@pytest.mark.parametrize("what", LOADERS)
def test_what_cannot_be_loaded_is_refused_with_the_reason(
    what: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text, told = BROKEN[kind]
    (tmp_path / f"broken_{kind}.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, f"broken_{kind}", raising=False)
    with pytest.raises(BadInputError, match=rf"(?s){what} 'broken_{kind}:Thing' cannot be loaded: .*{told}"):
        LOADERS[what](f"broken_{kind}:Thing")


ODD = """\
from dataclasses import dataclass
from typing import Any, ClassVar
from spot_model.effects.base import TorqueEffect, parameter


@dataclass(frozen=True, kw_only=True)
class Odd(TorqueEffect):
    name: ClassVar[str] = "odd"
    drag: Any = parameter(null=0.0, low=0.0, high=1.0, unit="1", source="none")

    def torque(self, torque_nm, motion, memory):
        return torque_nm * motion.speed_m_s, memory


@dataclass(frozen=True, kw_only=True)
class Half(TorqueEffect):
    name: ClassVar[str] = "half"
    drag: Any = parameter(null=0.0, low=0.0, high=1.0, unit="1", source="none")
"""


@pytest.mark.parametrize(("cls", "told"), [("Odd", r"'speed_m_s' \(.*line 12\)"), ("Half", "TypeError: .*abstract")])
def test_an_effect_that_is_not_whole_is_refused(
    cls: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "odd_effect.py").write_text(ODD)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "odd_effect", raising=False)
    with pytest.raises(BadInputError, match=told):
        chosen_library([f"odd_effect:{cls}"], [])


def test_an_effect_that_raises_while_it_is_simulated_is_told_as_the_users(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command ends as for any bad input, with the line of their file, and leaves nothing behind."""
    (tmp_path / "odd_effect.py").write_text(ODD)
    model = "schema: spot-rl/model/1\neffects:\n  - effect: odd_effect:Odd\n    drag: 0.5\n"
    (tmp_path / "model.yaml").write_text(model)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "odd_effect", raising=False)
    policy = Path(__file__).parents[2] / "policies" / "walk.onnx"
    with pytest.raises(SystemExit) as end:
        main(
            ["evaluate", str(policy), "--model", str(tmp_path / "model.yaml"), "--n", "1", "--out", str(tmp_path / "e")]
        )
    told = capsys.readouterr().err
    assert end.value.code == 2, told
    assert f"({tmp_path / 'odd_effect.py'}, line 12); the file is not part of spot-rl" in told
