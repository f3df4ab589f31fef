"""What was asked of the robot, what came, and how the odds moved; kept in a file, to go on from."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from math import log2
from pathlib import Path
from typing import Final

from diagnosis.next.choose.design import in_words
from diagnosis.next.choose.robots import LIKELY, all_beliefs
from diagnosis.verdict.posterior_file import Posterior
from spot_model.errors import BadInputError

SCHEMA: Final = "spot-rl/next-story/1"
WHOLE: Final = "completed"
"""Outcome of a run that went to its end."""
SURE: Final = 0.95
"""A cause of this probability is the answer."""
STILL: Final = 0.05
"""An experiment that moves less probability told nothing."""
LEAST: Final = 0.01
"""No probability counts as less: what is below is not told by name."""
LACKING: Final = "an effect that the library lacks"
OTHERS: Final = "others"
SHOWN: Final = 6
"""Causes that are told by name, at most."""


@dataclass(frozen=True)
class Found:
    """A diagnosis of all logs so far."""

    folder: Path
    posterior: Posterior
    status: str
    sentence: str

    @property
    def odds(self) -> dict[str, float]:
        """Probability of each cause, the likeliest first; at the end all that are hardly likely, together."""
        known = {in_words(c): (1.0 - self.posterior.unknown) * w for c, w in all_beliefs(self.posterior).items()}
        ranked = sorted({**known, LACKING: self.posterior.unknown}.items(), key=lambda item: -item[1])
        shown = [item for item in ranked[:SHOWN] if item[1] >= LIKELY]
        return {**dict(shown), OTHERS: 1.0 - sum(p for _, p in shown)}

    @property
    def top(self) -> tuple[str, float]:
        """The likeliest cause."""
        return next(iter(self.odds.items()))


@dataclass(frozen=True)
class Asked:
    """One round: what was asked, what came, how the odds moved."""

    name: str
    title: str
    values: str
    """Its chosen numbers."""
    parts: str
    """Which causes it was to set apart."""
    expected_bits: float
    robot_s: float
    outcome: str
    folder: str
    log: str
    """Empty where there is none that can be used."""
    found: str
    """Folder of the diagnosis with this log; empty where there is none yet."""
    before: dict[str, float]
    after: dict[str, float]
    status: str
    sentence: str

    @property
    def moved(self) -> float:
        """Probability that went over from some causes to others."""
        names = {*self.before, *self.after}
        return 0.5 * sum(abs(self.after.get(n, 0.0) - self.before.get(n, 0.0)) for n in names)

    @property
    def came_bits(self) -> float:
        """What the run told: Σ q log₂(q/p) from the odds p before to those q after; its expectation was foretold."""
        pairs = [(q, max(self.before.get(name, 0.0), LEAST)) for name, q in self.after.items() if q > LEAST]
        return max(sum(q * log2(q / p) for q, p in pairs), 0.0)


@dataclass
class Story:
    """All rounds, and how they ended."""

    first: Found
    rounds: list[Asked] = field(default_factory=list)
    ending: str = ""
    is_interrupted: bool = False

    @property
    def robot_s(self) -> float:
        """Robot time used, s."""
        return sum(r.robot_s for r in self.rounds)

    @property
    def odds(self) -> dict[str, float]:
        """Probability of each cause by now, the likeliest first."""
        return self.rounds[-1].after if self.rounds else self.first.odds

    @property
    def sentence(self) -> str:
        """The newest diagnosis in a sentence."""
        return self.rounds[-1].sentence if self.rounds else self.first.sentence

    @property
    def logs(self) -> list[Path]:
        """Of all rounds that left one."""
        return [Path(r.log) for r in self.rounds if r.log]

    @property
    def failed(self) -> list[str]:
        """Experiments that did not run to their end."""
        return [r.name for r in self.rounds if r.outcome != WHOLE]

    @property
    def excluded(self) -> list[str]:
        """Experiments that are not asked again: those that failed, and those that told nothing."""
        return self.failed + [r.name for r in self.rounds if r.outcome == WHOLE and r.moved < STILL]

    def to_json(self) -> str:
        """As text for ``story.json``."""
        data = {
            "schema": SCHEMA,
            "first": {"odds": self.first.odds, "status": self.first.status},
            "rounds": [asdict(r) for r in self.rounds],
            "robot_s": round(self.robot_s, 2),
            "ending": self.ending,
        }
        return json.dumps(data, indent=1) + "\n"


def read_story(path: Path, first: Found) -> Story:
    """The story so far, to go on from; an empty one where there is no file.

    Raises:
        BadInputError: The file is no story.
    """
    if not path.exists():
        return Story(first)
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if data["schema"] != SCHEMA:
            raise ValueError(f"schema is {data['schema']!r}, not {SCHEMA!r}")
        return Story(first, [Asked(**r) for r in data["rounds"]])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadInputError(f"{path} is no story of 'spot-rl diagnose next --run': {error}; move it away") from error
