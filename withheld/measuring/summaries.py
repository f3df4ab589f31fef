"""What a run's torques say in a few numbers: the part of each load that the servo law does not explain, regressed."""

from __future__ import annotations

from typing import Final

import numpy as np

from spot_model.policy.policy import Policy
from spot_model.robot.facts import JOINT_TYPES, STATE_PERIOD_NS, Array
from withheld.simulator.recording.run_arrays import RunArrays

STATE_S: Final = STATE_PERIOD_NS * 1e-9
SOFT_RAD_S: Final = 0.1
SKIPPED_STATES: Final = 340
"""The stand and the blend into the policy."""
N_SUMMARIES: Final = 6 * len(JOINT_TYPES)


def summaries(run: RunArrays, policy: Policy) -> Array:
    """Coefficients by joint type on one, velocity, its direction, acceleration, torque and torque's change, (18,)."""
    gains = policy.gains()
    rows = slice(SKIPPED_STATES, None)
    setpoint = run.setpoint_rad[np.maximum(run.echoed, 0)]
    asked = gains.kp_nm_per_rad * (setpoint - run.position_rad) - gains.kd_nm_s_per_rad * run.velocity_rad_s
    rate = np.gradient(run.velocity_rad_s, STATE_S, axis=0)
    change = np.gradient(asked, STATE_S, axis=0)
    one = np.ones_like(asked)
    v = run.velocity_rad_s
    columns = np.stack([one, v, np.tanh(v / SOFT_RAD_S), 0.01 * rate, 0.1 * asked, 0.001 * change], axis=-1)[rows]
    left = (run.load_nm - asked)[rows]
    found = []
    for k in range(len(JOINT_TYPES)):
        x, y = columns[:, k::3].reshape(-1, columns.shape[-1]), left[:, k::3].ravel()
        found.append(np.linalg.lstsq(x, y, rcond=None)[0])
    return np.concatenate(found)
