"""What to record next of a diagnosed robot."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from diagnosis.next.files import propose
from diagnosis.session import INPUTS
from spot_model.errors import BadInputError
from spot_model.policy.policy import Policy
from spot_rl.checks import AnyPath, existing, whole, with_our_errors
from spot_rl.inputs import policy_file


@with_our_errors
def next_experiment(diagnosis: AnyPath, *, policy: AnyPath | Policy | None = None, seed: int = 0) -> dict[str, Any]:
    """Say what to record next, as ``spot-rl diagnose next`` does: which recording makes the numbers in doubt surer.

    Takes some minutes on two cores. Writes next.html, menu.json and the best recording's file into the folder ``next``
    (``next-2``, … if it is there) of the diagnosis.

    Args:
        diagnosis: The folder that :func:`diagnose` or ``spot-rl diagnose`` wrote.
        policy: Policy for walks; by default the policy of the logs.
        seed: Random seed.

    Returns:
        ``page`` (path of next.html) and ``best``, the name of the recording that is worth running; None where none is.
        ``nothing`` says why none is, ``commands`` run it and diagnose again. ``recordings`` begin with the most
        telling. Each has its ``name``, ``robot_s``, ``needs``, ``loads``, and the reasons against it in ``refused``.
        ``numbers`` has what is in doubt: half-widths of 90 % intervals ``now`` and as ``expected`` afterwards.

    Raises:
        SpotRlError: The folder holds no diagnosis, or the policy is not valid.
    """
    folder: Path = existing(diagnosis, "diagnosis")
    if not (folder / INPUTS).is_file():
        raise BadInputError(
            f"diagnosis {folder} holds no {INPUTS}; give the folder that spot_rl.diagnose or spot-rl diagnose wrote"
        )
    file = None if policy is None else policy_file(policy)
    _, page = propose(folder, file, seed=whole(seed, "seed"))
    return {"page": page, **json.loads((page.parent / "menu.json").read_text(encoding="utf-8"))}
