"""The set-points of a joint experiment."""

from __future__ import annotations

from spot_model.policy.joint_script import JointScript
from spot_runtime.sources.base import Wanted


class JointScriptSource:
    """Plays the motion of an experiment once."""

    def __init__(self, script: JointScript) -> None:
        self.name, self._motion = script.experiment.name, script.motion

    def sample(self, active_s: float, host_stamp_ns: int) -> Wanted:
        """See the protocol; offsets of the set-points, shape (12,)."""
        del host_stamp_ns
        return Wanted(self._motion.at(active_s), is_finished=active_s >= self._motion.duration_s)

    def close(self) -> None:
        """Nothing is held."""
