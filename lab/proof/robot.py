"""The fake robot of a bench, and what a person with a tablet does to it between two runs."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from bosdyn.api import power_pb2
from bosdyn.client.estop import EstopClient
from bosdyn.client.power import PowerClient
from bosdyn.client.robot_command import RobotCommandBuilder, RobotCommandClient

from fake_robot.start.process import FakeAddress
from spot_model.robot import rotation
from spot_protos import fake_admin_pb2
from spot_runtime.config import RobotConfig
from spot_runtime.hal.address import parse_address
from spot_runtime.hal.spot.session import RobotCalls
from spot_runtime.host.clock import HostClock, RobotClockEstimate

OVERTURNED_RAD: Final = 0.5


@dataclass
class FakeRobot:
    """A fake robot in lock-step or real time, with the means to look at it and to break it."""

    address: FakeAddress
    admin: Any
    credentials_file: Path
    is_lock_step: bool
    estops: tuple[str, ...]
    """Who held the robot's e-stop at first."""

    def inject(self, name: str, lasts_s: float = 0.0, /, **parameters: float | str) -> None:
        """Make a fault of the fake robot happen now; 0 s: until it is cleared."""
        numbers = {k: v for k, v in parameters.items() if isinstance(v, float)}
        texts = {k: v for k, v in parameters.items() if isinstance(v, str)}
        request = fake_admin_pb2.InjectFaultRequest(name=name, numbers=numbers, texts=texts, duration_s=lasts_s)
        self.admin.InjectFault(request)

    def status(self) -> Any:
        """Ask for the robot's mode, power, owner and counters."""
        return self.admin.GetStatus(fake_admin_pb2.GetStatusRequest())

    @property
    def is_powered(self) -> bool:
        """Whether the motors have power."""
        return not self.status().motor_power.lower().endswith("off")

    @property
    def is_estopped(self) -> bool:
        """Whether an e-stop holds the robot."""
        return self.status().estop_level.lower() not in ("none", "estop_level_none")

    def truth(self, *, reset_extremes: bool = False) -> Any:
        """Ask for the simulated body as it is."""
        return self.admin.GetTruth(fake_admin_pb2.GetTruthRequest(reset_extremes=reset_extremes))

    def tilt_rad(self) -> float:
        """Ask how far the body leans."""
        return tilt_rad(self.truth())

    def step(self, seconds: float, part_s: float = 0.05) -> None:
        """Let robot time pass."""
        if not self.is_lock_step:
            time.sleep(seconds)
            return
        for _ in range(round(seconds / part_s)):
            self.admin.Step(fake_admin_pb2.StepRequest(duration_ns=round(part_s * 1e9)))

    @property
    def robot_config(self) -> RobotConfig:
        """How a client reaches the robot."""
        return RobotConfig(ca_file=self.address.ca_file, credentials_file=self.credentials_file)

    def clear_behavior_faults(self) -> tuple[str, ...]:
        """Do by hand what the runtime never does by itself. Returns who holds the e-stop. Raises HalError."""
        with self._session() as session:
            numbers = [int(text.rpartition("(")[2].rstrip(")")) for text in session.poll().behavior_faults]
            if numbers:
                session.sync_clocks()
                session.acquire_lease()
            client = session.calls.client(RobotCommandClient)
            for number in numbers:
                session.calls.make("clearing a fault", partial(client.clear_behavior_fault, number))
            status = session.calls.make("asking for the e-stop", session.calls.client(EstopClient).get_status)
            return tuple(endpoint.endpoint.name for endpoint in status.endpoints)

    def restore(self) -> str:
        """End all faults, clear behaviour faults, free the lease and set the robot upright, as a person would.

        Returns:
            What is left that the next run would suffer from, in words; nothing where the robot is good again.
        """
        self.admin.ClearFaults(fake_admin_pb2.ClearFaultsRequest())
        if self.status().lease_owner:
            self.inject("lease_expired")
        self.step(0.3)
        held_by = self.clear_behavior_faults()
        if self.tilt_rad() > OVERTURNED_RAD:
            self._turn_over()
        return self.left_over(held_by)

    def left_over(self, held_by: tuple[str, ...]) -> str:
        """Say what is not as it was; ``held_by`` are those who hold the e-stop now."""
        status = self.status()
        left = [f"the fault {fault.name}" for fault in status.active_faults]
        if self.is_estopped:
            left.append(f"an e-stop at {status.estop_level}")
        if held_by != self.estops:
            left.append(f"the e-stop in the hands of {', '.join(held_by) or 'nobody'}")
        if self.is_powered:
            left.append(f"motors {status.motor_power}")
        if status.lease_owner:
            left.append(f"the lease with {status.lease_owner}")
        return ", ".join(left)

    def _turn_over(self) -> None:
        """Set the robot upright by the vendor's own motion. Raises HalError."""
        with self._session() as session:
            session.sync_clocks()
            session.acquire_lease()
            power, command = session.calls.client(PowerClient), session.calls.client(RobotCommandClient)
            request = power_pb2.PowerCommandRequest.REQUEST_ON_MOTORS
            session.calls.make("powering on", lambda: power.power_command(request))
            self.step(2.5)
            for wanted in (RobotCommandBuilder.selfright_command(), RobotCommandBuilder.safe_power_off_command()):
                session.calls.make("turning over", partial(command.robot_command, wanted))
                self.step(4.0)

    @contextmanager
    def _session(self) -> Iterator[RobotCalls]:
        """Open the vendor's services as another client. Raises HalError."""
        clock = HostClock()
        address = parse_address(self.address.robot)
        session = RobotCalls(address, self.robot_config, clock, RobotClockEstimate(), clock.now_ns)
        try:
            session.log_in()
            yield session
        finally:
            session.close()


def tilt_rad(truth: Any) -> float:
    """Return how far a simulated body leans."""
    return float(rotation.tilt_rad(np.array(truth.world_from_body_wxyz)))
