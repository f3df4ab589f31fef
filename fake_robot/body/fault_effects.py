"""Where faults act: the sum of all that are active, rebuilt whenever one comes or goes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fake_robot.network.status import SystemFault
from fake_robot.network.streams import ChannelFault
from spot_model.robot.facts import N_JOINTS, Array


@dataclass
class FaultEffects:
    """What active faults change. A fresh one changes nothing."""

    # Channels
    states: ChannelFault = field(default_factory=ChannelFault)
    commands: ChannelFault = field(default_factory=ChannelFault)
    has_state_gap: bool = False
    duplicate_probability: float = 0.0
    """Share of state messages that are sent twice."""
    back_date_probability: float = 0.0
    """Share of state messages that bear the stamps of an earlier time."""
    back_date_s: float = 0.0
    malformed_states: str = ""
    """How state messages are spoilt; empty: not at all."""

    # Sensors
    is_frozen: bool = False
    """Every measured value stays as it was; stamps go on."""
    nan_signals: tuple[str, ...] = ()
    """Fields of a ``Report`` that turn into NaN."""
    quaternion_scale: float = 1.0

    # Clock and power
    clock_offset_s: float = 0.0
    battery_percent: float | None = None
    battery_missing: bool = False
    motor_temperature_c: dict[str, float] = field(default_factory=dict)
    motor_gain: Array = field(default_factory=lambda: np.ones(N_JOINTS))
    system_faults: list[SystemFault] = field(default_factory=list)

    @property
    def has_sensor_fault(self) -> bool:
        """Whether any reported value is changed."""
        return self.is_frozen or bool(self.nan_signals) or self.quaternion_scale != 1.0
