"""A log for ``spot-rl play LOG``: the recorded walk, a model's, and what a diagnosis found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from compare.cause import check_verdict, read_verdict
from compare.differences import differences
from compare.ghost import placed_beside
from compare.page import difference_sentence
from compare.tracks import STEP_S, CompareError, Track, aligned_tracks, track_of
from diagnosis.document import Difference, Verdict
from diagnosis.library.registry import LIBRARY
from diagnosis.read import find_policy
from diagnosis.report.words import joints_in_short, number
from spot_log.read.reader import read_run
from spot_log.read.run import Run
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel, load_model
from spot_model.plant.closed_loop import standing_height_m
from spot_model.policy.policy import Policy
from spot_model.robot.facts import JOINT_TYPES
from trainer.play.replay import Walked
from trainer.play.switches import BUILT_IN, Effects, Found, Switch
from trainer.signals.policy_ticks import Script, script_of
from trainer.simulate.recorded_runs import UsualNoise, simulate_scripts

USUAL_MODEL: Final = "paper_identified"


def read_diagnosed(log: Path, diagnosis: Path | None) -> tuple[Run, Verdict | None]:
    """A log, and the verdict in a folder of its diagnosis.

    Raises:
        CompareError: The diagnosis is of other logs, or not valid.
        LogReadError: The file is no log.
    """
    run = read_run(log)
    if diagnosis is None:
        return run, None
    verdict = read_verdict(diagnosis)
    check_verdict(verdict, diagnosis, run)
    return run, verdict


@dataclass(frozen=True)
class LogToPlay:
    """A log, and how its commands are simulated."""

    run: Run
    track: Track
    script: Script
    policy: Policy
    model: RobotModel
    model_name: str
    seed: int
    offered: tuple[Switch, ...]
    """What may be switched on in the model."""

    @classmethod
    def of(
        cls,
        run: Run,
        model: str | None = None,
        policy: Path | None = None,
        verdict: Verdict | None = None,
        seed: int = 0,
    ) -> LogToPlay:
        """A log under a model, by default its diagnosis' nominal one.

        Raises:
            CompareError: The log is too short, its policy is not known, or the model is not valid.
        """
        found = find_policy(policy, [run])
        if found is None:
            raise CompareError(
                f"{run.path}: the policy that ran is neither built in nor in policies/; give its file, --policy FILE"
            )
        script = script_of(run)
        if script is None:
            raise CompareError(f"{run.path} has less than a second under a policy; nothing can be simulated from it")
        name = model or (verdict.nominal if verdict is not None else "") or USUAL_MODEL
        offered = (switches_of(verdict) if verdict is not None else ()) or BUILT_IN
        try:
            simulated = load_model(name)
        except BadInputError as error:
            raise CompareError(f"{error}; name the model to simulate, --model") from error
        return cls(run, track_of(run, "The robot"), script, found, simulated, name, seed, offered)

    def recorded(self) -> Walked:
        """The recorded walk."""
        return self._walked(self.track, "The robot, as recorded", "")

    def simulate(self, effects: Effects, words: str, tell: Callable[[float], None]) -> Walked:
        """The model's walk with these effects; ``words`` say what is switched on, if anything."""
        rng = np.random.default_rng(self.seed)
        (run,) = simulate_scripts(RobotModel(effects), self.policy, [self.script], rng, UsualNoise(), tell=tell)
        model = Path(self.model_name).stem
        name = f"{model} with {words}" if words else model
        track = track_of(run, "the model with them" if words else model, is_simulated=True)
        try:
            reference, other = aligned_tracks([self.track, track])
            told = difference_sentence(reference, differences(reference, other))
        except CompareError as error:
            told = str(error)
        return self._walked(track, name, told)

    def _walked(self, track: Track, words: str, told: str) -> Walked:
        position, attitude = placed_beside(track, self.track, 0.0)
        # The height of odom is that of the place where the robot was switched on.
        position[:, 2] += standing_height_m(self.script.start) - self.track.position_of_body_in_odom_m[0, 2]
        qpos = np.hstack([position, attitude, track.position_rad])
        return Walked(words, told, STEP_S, qpos, track.body_velocity[:, 0], track.foot_contact)


def switches_of(verdict: Verdict) -> tuple[Switch, ...]:
    """What a diagnosis found, most evidence first; empty if it found nothing that the library has."""
    return tuple(_found(difference) for difference in verdict.differences if difference.name in LIBRARY)


def _found(difference: Difference) -> Found:
    numbers = {name: number.value for name, number in difference.parameters.items()}
    of_type = {
        kind: {**numbers, **{name: number.value for name, number in own.items()}}
        for kind, own in difference.by_type.items()
    }
    entry = LIBRARY[difference.name]

    def add(effects: Effects) -> Effects:
        model = RobotModel(effects)
        for kind in JOINT_TYPES if of_type else ("",):
            joints = tuple(joint for joint in difference.joints if joint.endswith(kind))
            if joints or not of_type:
                model = entry.add_to(model, of_type.get(kind, numbers), joints or ("all",))
        return model.effects

    where = f" at {joints_in_short(difference.joints)}" if difference.joints else ""
    sizes = ", ".join(number(n.value, n.unit) for n in difference.parameters.values())
    return Found(f"{difference.title or difference.name}{where}: {sizes}", add)
