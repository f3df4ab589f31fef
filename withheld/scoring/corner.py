"""The corner's cases beside the best possible answer: one who knows how they were drawn, from the same robots."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from withheld.measuring.attainable import NOTHING, Corner, learn, summaries_of_case
from withheld.outcome import Outcome
from withheld.scoring.rows import Row, share
from withheld.scoring.scores import is_right
from withheld.scoring.sizes import Size, sizes

ATTAINABLE: Final = "attainable.json"


def measure(outcomes: Sequence[Outcome], policies: Path, out: Path, seed: int, tell: Callable[[str], None]) -> Path:
    """Compute the best answer for each of the corner's cases, and write it beside the run.

    Args:
        outcomes: Of a run; cases of other kinds are left out.
        policies: Folder of the run's policies.
        out: Folder of the run.
        seed: Of the simulated robots, which are none of the run's.
        tell: Called with a line now and then.
    """
    corners: dict[str, Corner] = {}
    said: dict[str, dict[str, float]] = {}
    for o in outcomes:
        if o.case.kind != "corner":
            continue
        name = o.case.policy
        if name not in corners:
            tell(f"simulating robots under {name}")
            corners[name] = learn(policies / f"{name}.onnx", seed)
        said[str(o.case.number)] = corners[name].posterior(summaries_of_case(o.case, policies))
        tell(f"case {o.case.number} done")
    path = out / ATTAINABLE
    path.write_text(json.dumps(said, indent=1) + "\n", encoding="utf-8")
    return path


def corner_rows(outcomes: Sequence[Outcome], files: Sequence[Path]) -> list[Row]:
    """Right answers in the corner, by the diagnosis and by Bayes; only cases whose fault matters, or is none."""
    said: dict[str, dict[str, float]] = {}
    for file in files:
        if file.is_file():
            said |= json.loads(file.read_text(encoding="utf-8"))
    clear = [o for o in outcomes if o.case.kind == "corner" and sizes(o) in ((), (Size.LARGE,))]
    rows = [share("corner", "corner: right, by the diagnosis", [bool(is_right(o)) for o in clear])]
    known = [o for o in clear if str(o.case.number) in said]
    best = [max(of := said[str(o.case.number)], key=lambda k: of[k]) == _hidden(o) for o in known]
    return [*rows, share("corner_best", "corner: right, by Bayes' rule with the generator known", best)]


def _hidden(o: Outcome) -> str:
    return o.truth.faults[0].kind if o.truth.faults else NOTHING
