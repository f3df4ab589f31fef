"""What these logs cannot tell, which effects they cannot show, and what to record next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from diagnosis.channels import Channel, ChannelOff, Shape, Views
from diagnosis.channels.stack import Stack
from diagnosis.decision_constants import LEAST_NATS
from diagnosis.document import Difference, Split, UnknownEffect
from diagnosis.library import LibraryEffect
from diagnosis.library.experiments import Experiment
from diagnosis.library.registry import LIBRARY
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.scoring import Scorer, realistic_range
from spot_model.robot.facts import JOINT_NAMES

MIN_REPEATS = 3
FAST_M_S = 2.5


def split(experiment: Experiment) -> Split:
    """An experiment as something that can be recorded."""
    file = f"experiments/{experiment.sequence.name}.yaml"
    words = f"spot-rl collect --robot HOST --policy POLICY.onnx --out MORE_LOGS --sequences {file} --repeats 3"
    if experiment.kp_nm_per_rad is not None or experiment.kd_nm_s_per_rad is not None:
        kp, kd = experiment.kp_nm_per_rad or 60.0, experiment.kd_nm_s_per_rad or 1.5
        words += f" --other-gains {kp:g},{kd:g}"
    return Split(
        name=experiment.name, text=experiment.text, by_hand=experiment.by_hand, command=words, sequence_file=file
    )


def advice(
    logs: Stack,
    views: Views,
    off: Sequence[ChannelOff],
    differences: Sequence[Difference],
    unknown: UnknownEffect | None,
) -> tuple[str, ...]:
    """Sentences, the most useful first."""
    out = [
        f"To tell {_titles(effect.group)} apart: {effect.split.text} {effect.split.by_hand}".strip()
        for effect in differences
        if effect.split is not None
    ]
    counts = [sum(r.sequence == s.sequence for r in logs.recordings) for s in logs.recordings]
    if min(counts) < MIN_REPEATS:
        times = {1: "once", 2: "twice"}.get(min(counts), f"{min(counts)} times")
        out.append(f"Some command sequences were run {times}; five repeats narrow the intervals.")
    if len({r.sequence for r in logs.recordings}) < 2:
        out.append(
            "All logs are of one command sequence; record at least two more, so that a fit can be tested on others."
        )
    for reason in dict.fromkeys(c.reason for c in off):
        names = [c.name for c in off if c.reason == reason]
        words = f"Channel {names[0]} is" if len(names) == 1 else f"Channels {', '.join(names)} are"
        out.append(f"{words} off ({reason}).")
    gains = {
        (
            float(np.round(np.median(r.commands.kp_nm_per_rad), 3)),
            float(np.round(np.median(r.commands.kd_nm_s_per_rad), 3)),
        )
        for r in logs.recordings
        if len(r.commands)
    }
    is_spot = logs.recordings[0].joint_names == JOINT_NAMES
    if len(gains) == 1 and gains != {(0.0, 0.0)} and Channel.SET_POINT_TO_LOAD in views:
        how = " (spot-rl collect --other-gains 50,1)" if is_spot else ""
        out.append(
            "All logs have the same servo gains: a wrong gain cannot be distinguished from friction or a torque gain. "
            f"Record one short log at other gains{how}."
        )
    speeds = [np.nanmax(np.abs(r.velocity_command[:, 0]), initial=0.0) for r in logs.recordings]
    if is_spot and max(speeds) < FAST_M_S:
        out.append(
            f"The fastest command was {max(speeds):.1f} m/s: limits of torque, speed and power that act only above it "
            "cannot be seen. Record a sprint."
        )
    if unknown is not None and unknown.joints:
        out.append(
            f"Something unknown acts on {', '.join(unknown.joints)}; if you know what, write it as an effect and give "
            "--add-effect module:Class."
        )
    return tuple(out)


def _titles(names: Sequence[str]) -> str:
    return ", ".join(LIBRARY[name].title if name in LIBRARY else name for name in names)


def cannot_show(board: Evidence, library: Mapping[str, LibraryEffect] = LIBRARY) -> tuple[str, ...]:
    """Names of effects that show in no channel, or too little to be told from ordinary errors.

    An effect of its largest realistic size is expected to bring ½·xᵀ(W − W·Z(ZᵀWZ + 1)⁻¹ZᵀW)x nats, with Z the ordinary
    errors and W what a sample counts; none is named that brings fewer than :data:`LEAST_NATS`. Effects
    whose size is in their shape are sought where the logs have them: only a channel decides.
    """
    scorer = Scorer(board)
    return tuple(name for name, effect in library.items() if not _can_show(scorer, effect))


def _can_show(scorer: Scorer, effect: LibraryEffect) -> bool:
    board = scorer.board
    if not board.sees(effect):
        return False
    if not all(c.is_free for c in effect.coefficients):
        return True
    return any(expected_nats(scorer, effect, shape) >= LEAST_NATS for shape in board.shapes(effect))


def expected_nats(scorer: Scorer, effect: LibraryEffect, shape: Shape) -> float:
    """What the effect brings at its largest realistic size: the best coefficient at the best unit, or at all of them.

    Args:
        scorer: Of the ordinary errors alone.
        effect: All of whose coefficients are free.
        shape: Of the effect.
    """
    gram, _ = scorer.information(effect, shape, scorer.weights)
    size = realistic_range(effect)
    by_pair = gram.reshape(len(gram) // len(size), len(size), -1, len(size))
    alone, together = np.einsum("ukuk->uk", by_pair), np.einsum("ukvk->k", by_pair)
    return float(np.max(0.5 * size**2 * np.concatenate([alone, together[None]])))
