"""Lost commands, delay and jitter counted from the robot's receipts, on links made here whose truth is known."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diagnosis.channels import ChannelOff, ChannelView
from diagnosis.channels.program import FAST_QUANTILE, timing_view
from diagnosis.channels.receipts import Receipts, read
from diagnosis.channels.stack import stacked
from diagnosis.library.program import CommandDropEntry, CommandJitterEntry
from spot_log.format.records import RunHeader
from spot_log.read.run import run_of_columns
from spot_model.effects.commands import CommandDelay
from trainer.signals.recording import Recording, record

PERIOD_NS = 3_000_000
TICK_NS = 20_000_000
START_NS = 10**12
UP_S, LINK_S = 0.0013, 0.0025
"""Mean delays of states, and of commands of a link without jitter."""


def recording(
    every: int = 1,
    *,
    by_timer: bool = False,
    jitter_s: float = 0.0,
    loss: float = 0.0,
    burst: float = 1.0,
    twice: float = 0.0,
    shift_s: float = 0.0,
    n: int = 4000,
    seed: int = 0,
) -> tuple[Recording, float]:
    """A log of a link that keeps the order of commands, and the share of its commands that were lost.

    Commands answer every so many states, or a timer of 50 Hz; some are sent twice, 0.4 ms apart. ``burst`` is the mean
    number of commands lost in a row.
    """
    rng = np.random.default_rng(seed)
    stamp = START_NS + PERIOD_NS * np.arange(n)
    if by_timer:
        sent = np.arange(START_NS + PERIOD_NS, stamp[-1], TICK_NS)
        answered = stamp[np.searchsorted(stamp, sent) - 1]
    else:
        answered = stamp[::every]
        sent = answered + round(UP_S * 1e9)
    again = rng.random(len(sent)) < twice
    sent, answered = np.concatenate([sent, sent[again] + 400_000]), np.concatenate([answered, answered[again]])
    order = np.argsort(sent, kind="stable")
    sent, answered = sent[order], answered[order]
    delay_s = (
        LINK_S - 0.001 + shift_s + rng.gamma(2.0, 0.0005, len(sent)) + jitter_s * rng.standard_exponential(len(sent))
    )
    lost, is_bad, enter = np.zeros(len(sent), np.bool_), False, loss / burst / (1.0 - loss)
    for k, draw in enumerate(rng.random(len(sent)).tolist()):
        is_bad = draw >= 1.0 / burst if is_bad else draw < enter
        lost[k] = is_bad
    arrival = np.where(lost, 0, sent + np.round(delay_s * 1e9).astype(np.int64))
    arrived = np.flatnonzero(~lost)
    arrival = np.maximum.accumulate(arrival)[arrived]
    newest = np.searchsorted(arrival, stamp, side="right") - 1
    key = np.where(newest >= 0, arrived[newest] + 1, 0)
    run = run_of_columns(
        Path("link.mcap"),
        RunHeader(run_id="link", started_host_stamp_ns=START_NS),
        states={
            "robot_stamp_ns": stamp,
            "last_command_key": key,
            "last_command_robot_stamp_ns": np.where(newest >= 0, arrival[newest], 0),
        },
        commands={"key": np.arange(len(sent)) + 1, "robot_stamp_ns": sent, "state_robot_stamp_ns": answered},
        ticks={"robot_stamp_ns": stamp[:1]},
    )
    return record(run), float(lost[:-8].mean())


def counted(runs: Sequence[tuple[Recording, float]]) -> tuple[Receipts, float, float, float]:
    """What is read, and its mean share lost, delay and lateness."""
    told = read([r for r, _ in runs], FAST_QUANTILE)
    known = np.isfinite(told.lost) & (told.lost < 1.0)
    weight = 1.0 - told.lost[known]
    delay_s, late_s = (float(np.average(v[known], weights=weight)) for v in (told.delay_s, told.late_s))
    return told, float(np.nanmean(told.lost)), delay_s, late_s


CASES: dict[str, dict[str, Any]] = {
    "with every state": {},
    "just before a state": {"shift_s": 0.0018},
    "every sixth state": {"every": 6},
    "timer": {"by_timer": True},
    "two close together": {"by_timer": True, "twice": 0.3},
    "timer, jitter of 4 ms": {"by_timer": True, "jitter_s": 0.004},
    "with every state, jitter of 4 ms": {"jitter_s": 0.004},
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_no_command_is_lost_that_others_hide(case: dict[str, Any]) -> None:
    told, lost, delay_s, late_s = counted([recording(**case, seed=s) for s in range(4)])
    assert lost < 0.003
    assert told.error < 0.04
    by_itself_s = LINK_S + case.get("shift_s", 0.0) + case.get("jitter_s", 0.0)
    if not case.get("by_timer"):
        assert delay_s == pytest.approx(UP_S + by_itself_s, abs=0.0003)
    # A gamma distribution's own spread, and an exponential's.
    assert late_s == pytest.approx(0.0008 + case.get("jitter_s", 0.0) * 0.95, abs=0.0005)


@pytest.mark.parametrize("burst", [1.0, 3.0])
@pytest.mark.parametrize("loss", [0.015, 0.05])
@pytest.mark.parametrize(
    "case", [{"every": 6}, {"by_timer": True, "twice": 0.3}, {"by_timer": True, "jitter_s": 0.002}], ids=str
)
def test_lost_commands_are_counted_alone_or_in_bursts(case: dict[str, Any], loss: float, burst: float) -> None:
    runs = [recording(**case, loss=loss, burst=burst, seed=s) for s in range(4)]
    told, lost, _, _ = counted(runs)
    assert lost == pytest.approx(float(np.mean([share for _, share in runs])), rel=0.2)
    assert told.error < 0.015


@pytest.mark.parametrize("burst", [1.0, 2.0])
def test_losses_show_through_commands_that_hide_each_other(burst: float) -> None:
    runs = [recording(loss=0.04, burst=burst, seed=s) for s in range(6)]
    _, lost, _, _ = counted(runs)
    assert lost == pytest.approx(float(np.mean([share for _, share in runs])), rel=0.2)


def test_where_most_hide_none_is_counted_and_the_uncertainty_says_so() -> None:
    told, lost, _, _ = counted([recording(loss=0.03, jitter_s=0.004, seed=s) for s in range(4)])
    assert lost == 0.0
    assert told.error > 0.02


def test_the_channel_has_rows_and_noise_of_the_count() -> None:
    logs = stacked([recording(every=6, loss=0.03, jitter_s=0.002, seed=s)[0] for s in range(2)])
    view = timing_view(logs, (CommandDelay(delay_s=UP_S + LINK_S),))
    assert isinstance(view, ChannelView)
    assert view.rows == ("delay", "spread", "lost")
    delay_s, spread_s, lost = np.nanmean(view.response, axis=0)
    n_commands = 2 * 4000 / 6
    assert view.noise[2] / np.sqrt(view.n) == pytest.approx(np.sqrt(lost / n_commands), rel=0.3)
    assert (CommandDropEntry().columns(view, {}, np.zeros(12, np.bool_))[0] == [[0.0], [0.0], [1.0]]).all()
    column = CommandJitterEntry().columns(view, {"mean_s": 0.002}, np.zeros(12, np.bool_))[0].ravel()
    assert column[0] == pytest.approx(delay_s, abs=0.0003)
    assert column[1] == pytest.approx(spread_s - 0.0008, abs=0.0004)
    assert column[2] == 0.0


def test_commands_that_wait_out_a_pause_are_no_matter_of_the_link() -> None:
    logs = stacked([recording(shift_s=1.5)[0]])
    off = timing_view(logs, ())
    assert isinstance(off, ChannelOff)
    assert "within a second" in off.reason
