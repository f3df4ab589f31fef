"""PYTHONPATH without the current folder, for which an empty or relative entry stands: call it before other imports.

A ``json.py`` that lies there would run in a process that knows how to log in to a robot. What Python itself imports
before our first line is out of reach.
"""

import os
import sys

VARIABLE = "PYTHONPATH"
TAKES_MODULES = ("compare", "diagnose", "evaluate", "export", "improve", "play", "refine", "sysid", "train", "withheld")
"""Commands that take ``module:name`` of the user's: what a relative entry names comes after all other modules there."""


_full, _is_full = os.path.abspath, os.path.isabs  # pathlib would be one of those other imports


def absolute_entries(value: str) -> str:
    """The entries that mean the same in every folder."""
    return os.pathsep.join(filter(_is_full, value.split(os.pathsep)))


def leave_out_relative_entries(command: str = "") -> dict[str, str]:
    """Take what is relative from this process's modules and its environment.

    Args:
        command: Of ``spot-rl``, if that runs.

    Returns:
        The entries that were left out, and the folders that they led to; no empty one, which nobody writes on purpose.
    """
    value = os.environ.get(VARIABLE, "")
    relative = {entry: _full(entry) for entry in value.split(os.pathsep) if not _is_full(entry)} if value else {}
    if not relative:
        return {}
    kept = absolute_entries(value)
    named = [entry for entry in relative if entry and command in TAKES_MODULES]
    gone = set(relative.values()) - set(map(_full, filter(None, kept.split(os.pathsep))))
    root = __file__.rpartition(f"{os.sep}spot_model{os.sep}")[0]
    behind = gone & {root, *map(_full, named)} & set(sys.path)
    sys.path[:] = [*(folder for folder in sys.path if folder not in gone), *sorted(behind)]
    os.environ[VARIABLE] = os.pathsep.join(filter(None, [kept, *named]))
    return {entry: full for entry, full in relative.items() if entry and entry not in named}
