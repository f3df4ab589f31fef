"""A run's topics as pandas data frames."""

from __future__ import annotations

from typing import Any

import numpy as np

from spot_log.read.flat_tables import tables_of
from spot_log.read.run import Run
from spot_model.errors import BadInputError


class FrameError(BadInputError):
    """A run cannot be given as a data frame."""


def frame_of(run: Run, topic: str = "state") -> Any:
    """One topic as a ``pandas.DataFrame``: one row a message, one column a signal and joint, such as ``load_nm.fl_kn``.

    Returns:
        The frame, indexed by ``time_s``: seconds of the robot's clock since the run's first state. A row without a
        robot stamp has the index NaN.

    Raises:
        FrameError: The topic is unknown, or pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError as error:
        raise FrameError("data frames need pandas: pip install 'spot-rl[report]'") from error
    tables = tables_of(run)
    if topic not in tables:
        raise FrameError(f"topic {topic!r} is not in a log; allowed: {', '.join(tables)}")
    table = tables[topic]
    stamps = table["robot_stamp_ns"]
    start_ns = int(run.states.robot_stamp_ns[0]) if len(run.states) else int(stamps.min(initial=0))
    time_s = np.where(stamps > 0, (stamps - start_ns) * 1e-9, np.nan)
    return pd.DataFrame(dict(table), index=pd.Index(time_s, name="time_s"))
