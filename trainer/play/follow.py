"""The policy of a training under way: that of its newest checkpoint."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from spot_model.policy.policy import Policy
from trainer.ppo.checkpoint import find_checkpoint
from trainer.ppo.checkpoint_policy import checkpoint_policy

LOOKED_EVERY_S = 2.0


class NewestPolicy:
    """Looks for a newer checkpoint now and then."""

    def __init__(self, run: Path, tell: Callable[[str], None]) -> None:
        self._run, self._tell = run, tell
        self._seen: Path | None = None
        self._looked_s = -LOOKED_EVERY_S

    def load(self) -> Policy:
        """The newest.

        Raises:
            BadInputError: The run has no checkpoint yet.
        """
        self._seen = find_checkpoint(self._run)
        self._tell(self._seen.name)
        return checkpoint_policy(self._seen)

    def newer(self) -> Policy | None:
        """One that is newer than the last; None if there is none, or it was looked for a moment ago."""
        now_s = time.monotonic()
        if now_s - self._looked_s < LOOKED_EVERY_S:
            return None
        self._looked_s = now_s
        return None if find_checkpoint(self._run) == self._seen else self.load()
