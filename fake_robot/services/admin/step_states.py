"""States for the answers to Step: a state stream without a call of its own."""

from __future__ import annotations

from fake_robot.services.sensors.world import World


class StateTap:
    """Collects what a state stream would bring. Whatever ends state streams ends this one, too."""

    def __init__(self, world: World) -> None:
        """Collect from now on."""
        self._subscription = world.robot.subscribe_state()
        self._forget = world.link.listen("state", self._subscription.close)

    @property
    def is_closed(self) -> bool:
        """Whether no message will come any more."""
        return self._subscription.is_closed

    def take(self) -> list[bytes]:
        """The messages since the last call."""
        messages = []
        while (message := self._subscription.get(0.0)) is not None:
            messages.append(message)
        return messages

    def close(self) -> None:
        """Collect no more."""
        self._forget()
        self._subscription.close()
