"""The claims that ``spot-rl bench all`` measures: one script each, what it is compared with, and what is asked."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

Bound = tuple[str, float]
"""``(">=", 4.0)``, or with ``<=``."""
AHEAD: Final[Bound] = (">=", 1.0)


@dataclass(frozen=True)
class Ratio:
    """Two figures of one run, the first over the second; figures are named by their path in the script's object."""

    over: str
    under: str = ""
    """Empty: the figure by itself."""
    asked: Bound | None = None


@dataclass(frozen=True)
class Claim:
    """One script's measurement."""

    script: str
    """Below ``benchmarks``, with its arguments."""
    expected_s: float
    """Of one repeat on two idle cores: for the time left."""
    ratios: dict[str, Ratio] = field(default_factory=dict)
    repeats: int = 3


def _loop(compute: Bound | None, answer: Bound | None) -> dict[str, Ratio]:
    return {
        "textbook compute / ours, median": Ratio("textbook.compute_us_p50", "ours.compute_us_p50", compute),
        "textbook compute / ours, 99 %": Ratio("textbook.compute_us_p99", "ours.compute_us_p99", AHEAD),
        "our state to command / bare echo, median": Ratio(
            "ours.state_to_command_ms_p50", "echo.state_to_command_ms_p50", answer
        ),
        "textbook state to command / ours, 99 %": Ratio(
            "textbook.state_to_command_ms_p99", "ours.state_to_command_ms_p99", AHEAD
        ),
        "textbook period error / ours": Ratio("textbook.period_error_mean_ms", "ours.period_error_mean_ms", AHEAD),
        "our slipped ticks": Ratio("ours.slipped", asked=("<=", 0.0)),
    }


CLAIMS: Final = {
    "loop, idle": Claim("claims/loop.py", 57.0, _loop((">=", 4.0), ("<=", 1.5))),
    "loop, two busy processes": Claim("claims/loop.py --busy 2", 57.0, _loop((">=", 4.0), ("<=", 1.5))),
    "loop without priority, two busy processes": Claim(
        "claims/loop.py --busy 2 --plain", 57.0, _loop(None, None), repeats=1
    ),
    "fake robot": Claim(
        "claims/fakes.py",
        120.0,
        {
            "error of delays, ms": Ratio("delay_ms.largest_error_ms", asked=("<=", 1.0)),
            "fakes held at 333 Hz": Ratio("fakes_held", asked=(">=", 2.0)),
        },
        repeats=2,
    ),
    "lock-step": Claim("loop_lock_step.py", 9.0, {"times real time": Ratio("times_real_time", asked=(">=", 7.0))}),
    "log": Claim(
        "claims/log.py",
        60.0,
        {
            f"{peer} {told} / ours": Ratio(f"{peer}.{figure}", f"ours.{figure}", asked)
            for peer in ("json_lines", "hdf5", "plain_mcap")
            for figure, told, asked in (
                ("cost_us_p50", "cost a message, median", AHEAD),
                ("cost_us_max", "cost a message, worst", None),
                ("mb_a_minute", "MB a minute", AHEAD),
                ("read_s_per_10_min", "time to arrays", AHEAD),
            )
        },
    ),
    "training": Claim(
        "claims/training.py",
        22.0,
        {name: Ratio(f"{name}_share_of_bare") for name in ("plant", "physics", "collecting", "with_learning")},
    ),
    "speed of identification": Claim(
        "spot-rl bench sysid --json", 30.0, {"evaluations / plain mj_step": Ratio("ratio")}
    ),
    "accuracy of identification": Claim("claims/identification.py", 120.0, repeats=1),
    "the same truth by PACE's method": Claim("claims/pace.py", 40.0, repeats=1),
    "start-up": Claim(
        "start_up.py 1",
        16.0,
        {
            "help, s": Ratio("help_s.median", asked=("<=", 0.3)),
            "first state, s": Ratio("first_state_s.median", asked=("<=", 1.5)),
            "resident, MB": Ratio("rss_mb.median", asked=("<=", 150.0)),
        },
    ),
    "size": Claim("claims/size.py", 10.0, {"runtime, MB installed": Ratio("runtime.mb", asked=("<=", 200.0))}, 1),
}
