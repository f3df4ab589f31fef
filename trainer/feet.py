"""How long each foot has been in the air or on the ground."""

from __future__ import annotations

import torch

Tensor = torch.Tensor


class FootTimers:
    """Contact timers of n robots' four feet; every tensor has shape (n, 4), s."""

    NAMES = ("air_time_s", "contact_time_s", "last_air_time_s", "last_contact_time_s")

    def __init__(self, n: int, device: torch.device | str) -> None:
        self.air_time_s = torch.zeros(n, 4, device=device)
        self.contact_time_s = torch.zeros(n, 4, device=device)
        self.last_air_time_s = torch.zeros(n, 4, device=device)
        self.last_contact_time_s = torch.zeros(n, 4, device=device)

    def update(self, contact: Tensor, dt_s: float) -> Tensor:
        """Count one more period with ``contact`` (bool, (n, 4)); returns which feet touched down in it.

        A phase's length is kept when it ends, with the period in which it ended counted in.
        """
        touched_down = contact & (self.air_time_s > 0)
        lifted_off = ~contact & (self.contact_time_s > 0)
        self.last_air_time_s.copy_(torch.where(touched_down, self.air_time_s + dt_s, self.last_air_time_s))
        self.last_contact_time_s.copy_(torch.where(lifted_off, self.contact_time_s + dt_s, self.last_contact_time_s))
        self.air_time_s.add_(dt_s).mul_(~contact)
        self.contact_time_s.add_(dt_s).mul_(contact)
        return touched_down

    def reset(self, mask: Tensor) -> None:
        """Zero the timers of the robots in ``mask`` (bool, (n,))."""
        keep = ~mask[:, None]
        for name in self.NAMES:
            getattr(self, name).mul_(keep)
