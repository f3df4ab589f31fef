"""What the residual channels say, without any simulation: the evidence, and the sets of effects that it favours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from diagnosis.channels import Channel, ChannelOff, Views
from diagnosis.channels.build import build_views
from diagnosis.channels.stack import Stack, stacked
from diagnosis.decision_constants import ERROR_SCALES
from diagnosis.library import JointGroups, LibraryEffect
from diagnosis.library.held import less_held
from diagnosis.library.registry import LIBRARY
from diagnosis.read.robot_file import SPOT, RobotFile
from diagnosis.selection.evidence import Evidence, lay_out
from diagnosis.selection.normal_equations import one_thread
from diagnosis.selection.ordinary_errors import of_unknown_drive
from diagnosis.selection.scoring import Placed, Scorer, null_of
from diagnosis.selection.search import Say, Selection, effects_of, search_effects, selection_of
from spot_log.read.run import Run
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy
from trainer.signals.recording import record


@dataclass(frozen=True)
class Explanation:
    """Evidence and what was chosen from it."""

    stack: Stack
    views: Views
    off: tuple[ChannelOff, ...]
    board: Evidence
    selection: Selection

    @property
    def n_runs(self) -> int:
        """Logs."""
        return len(self.stack.recordings)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the chosen effects."""
        return effects_of(self.selection.best.terms)

    def with_effects(self, terms: Sequence[Placed], library: Mapping[str, LibraryEffect]) -> Explanation:
        """The same evidence with another set of effects, maybe none."""
        if not terms:
            return replace(self, selection=Selection(null_of(self.board), {}, {}, {}, self.selection.first))
        best = Scorer(self.board, terms).now
        return replace(self, selection=selection_of(self.board, best, self.selection.first, library))


def weigh(
    runs: Sequence[Run],
    nominal: RobotModel,
    policy: Policy | None,
    library: Mapping[str, LibraryEffect],
    say: Say,
    robot: RobotFile = SPOT,
) -> Explanation:
    """Channels, evidence, and the best set of effects; progress goes to ``say``.

    Raises:
        BadInputError: The logs feed no channel at all.
    """
    with one_thread():
        logs, views, off, board = evidence_of(runs, nominal, policy, library, robot)
        say(f"trying {len(library)} effects on {len(board.blocks)} signals of {len(views)} channels")
        return Explanation(logs, views, off, board, search_effects(board, library, say))


def evidence_of(
    runs: Sequence[Run],
    nominal: RobotModel,
    policy: Policy | None,
    library: Mapping[str, LibraryEffect],
    robot: RobotFile = SPOT,
) -> tuple[Stack, Views, tuple[ChannelOff, ...], Evidence]:
    """Logs on one grid, channels that are on and off, and the evidence.

    Raises:
        BadInputError: Nothing of the logs can be used, or they feed no channel at all.
    """
    logs = stacked([record(run) for run in runs])
    if not logs.used.any():
        cuts = dict.fromkeys(s.reason for own in logs.segmentations for s in own.segments)
        told = "record the robot while commands move it, on its feet"
        raise BadInputError(f"nothing of these logs can be used: {'; '.join(cuts)}; {told}")
    views, off = build_views(logs, nominal, policy=policy, robot=robot)
    if not views:
        told = "; ".join(f"{c.name}: {c.reason}" for c in off)
        raise BadInputError(f"these logs feed no channel ({told}); map joint velocities, loads or set-points as well")
    joints = JointGroups(logs.joint_names, logs.legs)
    names = sorted({r.sequence for r in logs.recordings})
    by_run = len(names) < 2
    folds = list(range(len(runs))) if by_run else [names.index(r.sequence) for r in logs.recordings]
    fold_names = [r.run_id for r in logs.recordings] if by_run else names
    # Ordinary errors are of either sign by themselves.
    every = {**LIBRARY, **{name: entry for name, entry in library.items() if not entry.taken_away}}
    views = less_held(views, nominal.effects, every)
    drive = views.get(Channel.SET_POINT_TO_LOAD)
    scales = of_unknown_drive(drive) if robot.is_from_motion and drive is not None else ERROR_SCALES
    board = lay_out(views, joints, folds, fold_names, library=every, scales=scales, period_s=logs.period_s)
    return logs, views, tuple(off), board
