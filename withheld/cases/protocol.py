"""How many cases of which kind a run holds, and how large and how well recorded its faults are."""

from __future__ import annotations

from typing import Final, Literal

from withheld.plan import Place

CaseKind = Literal["faultless", "single", "sprint", "double", "outside", "left_out", "short", "own"]
SLOTS: Final[dict[CaseKind, int]] = {
    "faultless": 15,
    "single": 24,
    "sprint": 6,
    "double": 15,
    "outside": 12,
    "left_out": 3,
    "short": 5,
}
"""Of every eighty cases; their order is drawn. Ten such blocks are a whole run."""
BLOCK: Final = sum(SLOTS.values())
WHOLE_RUN: Final = 10 * BLOCK
WORDS: Final[dict[CaseKind, str]] = {
    "faultless": "no fault",
    "single": "one effect of the library",
    "sprint": "power, rotor, friction or heat at 4 to 6 m/s",
    "double": "two effects of the library",
    "outside": "one effect that the library does not have",
    "left_out": "one effect that is left out of the library for the case",
    "short": "one short run as a foreign recording has it",
    "own": "a user's reality",
}
SIZES: Final = (0.3, 1.0)
"""Bounds of a fault's size, uniform; 1 is the end of its realistic range."""
PLACES: Final[dict[Place, float]] = {"joint": 1.0, "leg": 1.0, "type": 2.0, "all": 2.0, "body": 1.0}
"""Weights of the places at which a kind may act."""
REPEATS: Final[dict[int, float]] = {5: 0.6, 2: 0.2, 1: 0.2}
"""Runs of each of three sequences, and how often so many are recorded."""
SECONDS: Final[dict[int, float]] = {5: 6.0, 2: 8.0, 1: 12.0}
"""Length of a sequence by repeats."""
SHORT_S: Final = (3.0, 9.0)
MISSING_SHARE: Final = 0.15
"""Share of cases whose logs lack one or two signals."""
SPRINT_KINDS: Final = (
    "power_budget",
    "corroded_cable",
    "loaded_rotor",
    "dry_bearing",
    "rubbing_teeth",
    "warm_magnets",
)
"""What can explain missing torque at speed: the limit that the paper names, and its rivals."""
SPRINT_SIZES: Final = (0.5, 1.0)
SPRINT_M_S: Final = 4.0
"""A policy that is told to go slower cannot sprint."""
