"""The identification in words: a summary and a table for a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from spot_model.text import counted
from trainer.sysid.identify.result import ResultData
from trainer.sysid.identify.verdict import ParameterVerdict


def summary(data: ResultData) -> str:
    """What was found, in two or three sentences."""
    found = [p for p in data.parameters if p.identified]
    unit = " (1 is the real-versus-real floor)" if data.score_is_over_floor else " (no floor: repeats are missing)"
    score = ", ".join(f"{name} {'diverged' if value is None else f'{value:.2f}'}" for name, value in data.score.items())
    are = "is" if len(found) == 1 else "are"
    return (
        f"{len(found)} of {counted(len(data.parameters), 'parameter')} {are} identified from "
        f"{counted(len(data.logs), 'log')} of {counted(len(data.sequences), 'command sequence')}. Score{unit}: {score}."
    )


def text_table(parameters: Sequence[ParameterVerdict]) -> str:
    """The parameters as lines for a terminal."""
    width = max(len(p.name) for p in parameters)
    lines = [
        f"{p.name:<{width}}  {p.value:9.4g} {p.unit:<6} [{p.low:.4g}, {p.high:.4g}]  {p.source}"
        + ("" if p.identified else f": {p.reason}")
        for p in parameters
    ]
    return "\n".join(lines)
