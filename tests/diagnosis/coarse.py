"""A log as a stranger's recorder writes it: fewer states, at uneven steps, and less in each."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from spot_log.read.run import ImuTable, Run, StateTable


def uneven(n_states: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Rows of a 3 ms stream at steps of 15, 18 and 21 ms, as a real recording of 55 Hz has them."""
    return np.cumsum(rng.integers(5, 8, n_states // 7))


def thinned(run: Run, at: NDArray[np.intp]) -> Run:
    """The run with these states alone: no receipts, no contact flags, no inertial unit, no policy."""
    none = np.zeros(0, dtype=np.int64)
    columns = {f.name: getattr(run.states, f.name)[at] for f in dataclasses.fields(StateTable) if f.name != "imu"}
    columns |= {
        "sequence": np.arange(len(at)),
        "last_command_key": np.zeros(len(at), dtype=np.int64),
        "last_command_robot_stamp_ns": np.zeros(len(at), dtype=np.int64),
        "foot_contact": np.zeros((len(at), 0), dtype=np.bool_),
    }
    imu = ImuTable(none, none, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 4)))
    header = dataclasses.replace(run.header, policy_contract_json="", policy_name="", policy_sha256="")
    return dataclasses.replace(run, header=header, states=StateTable(imu=imu, **columns))
