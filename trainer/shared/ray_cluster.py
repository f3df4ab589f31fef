"""Connection to a Ray cluster (the extra ``ray``): a running one, or one started on this machine."""

from __future__ import annotations

from typing import Any

from spot_model.errors import SpotRlError


class EngineError(SpotRlError):
    """An engine cannot be started."""


class RayCluster:
    """A connection to a cluster; what it started, it ends."""

    def __init__(self, address: str | None = None) -> None:
        """Prepare; nothing is started yet.

        Raises:
            EngineError: Ray is not installed.
        """
        try:
            import ray
        except ModuleNotFoundError as error:
            raise EngineError(
                "engine ray: Ray is not installed; install the extra: pip install 'spot-rl[ray]'"
            ) from error
        self.ray: Any = ray
        self._address = address
        self._owns_it = False

    def join(self) -> None:
        """Connect, unless this process is connected already.

        Raises:
            EngineError: There is no cluster at the address.
        """
        if self.ray.is_initialized():
            return
        try:
            self.ray.init(address=self._address, include_dashboard=False, log_to_driver=False)
        except (ConnectionError, RuntimeError, ValueError) as error:
            raise EngineError(
                f"engine ray: no cluster at {self._address or 'this machine'}: {error}; start one with 'ray start "
                "--head', or leave --ray-address out"
            ) from error
        self._owns_it = True

    def leave(self) -> None:
        """Disconnect, if :meth:`join` connected."""
        if self._owns_it:
            self.ray.shutdown()
