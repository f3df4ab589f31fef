"""How long each foot has been in the air or on the ground."""

from __future__ import annotations

import torch

Tensor = torch.Tensor


class FootTimers:
    """Contact timers of n robots' four feet; every tensor has shape (n, 4), s.

    Args:
        n: Robots.
        device: Where the tensors are.
        duty_window_s: Time constant of the mean that :attr:`duty` is.
    """

    NAMES = ("air_time_s", "contact_time_s", "last_air_time_s", "last_contact_time_s", "duty", "support")

    def __init__(self, n: int, device: torch.device | str, duty_window_s: float = 1.0) -> None:
        self.air_time_s = torch.zeros(n, 4, device=device)
        self.contact_time_s = torch.zeros(n, 4, device=device)
        self.last_air_time_s = torch.zeros(n, 4, device=device)
        self.last_contact_time_s = torch.zeros(n, 4, device=device)
        self.duty = torch.zeros(n, 4, device=device)
        """Share of time on the ground, a mean that forgets; starts from 0 for all feet alike."""
        self.support = torch.zeros(n, 4, dtype=torch.bool, device=device)
        """The feet on the ground; in flight those that were last."""
        self._duty_window_s = duty_window_s

    def update(self, contact: Tensor, dt_s: float, duty: Tensor | None = None) -> Tensor:
        """Count one more period with ``contact`` (bool, (n, 4)); returns which feet touched down in it.

        A phase's length is kept when it ends, with the period in which it ended counted in. ``duty`` is the share of
        the period in which each foot stood, shape (n, 4), where it is known.
        """
        touched_down = contact & (self.air_time_s > 0)
        lifted_off = ~contact & (self.contact_time_s > 0)
        self.last_air_time_s.copy_(torch.where(touched_down, self.air_time_s + dt_s, self.last_air_time_s))
        self.last_contact_time_s.copy_(torch.where(lifted_off, self.contact_time_s + dt_s, self.last_contact_time_s))
        self.support.copy_(torch.where(contact.any(dim=-1, keepdim=True), contact, self.support))
        self.air_time_s.add_(dt_s).mul_(~contact)
        self.contact_time_s.add_(dt_s).mul_(contact)
        self.duty.lerp_(contact.to(self.duty.dtype) if duty is None else duty, min(1.0, dt_s / self._duty_window_s))
        return touched_down

    def reset(self, mask: Tensor) -> None:
        """Zero the timers of the robots in ``mask`` (bool, (n,))."""
        keep = ~mask[:, None]
        for name in self.NAMES:
            getattr(self, name).mul_(keep)
