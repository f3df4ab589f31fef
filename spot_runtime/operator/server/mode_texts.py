"""The modes of the control loop in an operator's words."""

from __future__ import annotations

from typing import Final

from spot_runtime.control.modes import Mode

MODE_TEXTS: Final = {
    Mode.READY: "the vendor's stand holds the robot, the load is averaged",
    Mode.ACTIVATING: "the measured pose is sent while the robot switches to joint control",
    Mode.RAMPING_IN: "from the measured pose with the stand's gains to the policy",
    Mode.ACTIVE: "the policy follows the velocity command",
    Mode.SOFT_STOP: "the velocity command fades to zero",
    Mode.RAMPING_OUT: "from the policy back to the held pose",
    Mode.STANDING: "the pose is held until the vendor's stand takes over",
    Mode.DAMPING: "no stiffness, only damping: the robot sinks",
    Mode.RELEASED: "nothing is sent any more",
}
