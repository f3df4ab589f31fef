"""Settings of the services: who the robot is, and the policies that nobody can know without a robot."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from fake_robot.scenario.parts import Part


class ServicesConfig(Part):
    """The ``services`` part of a scenario. Times are in seconds.

    Timeouts of leases and e-stop endpoints run on robot time. In lock-step they also wait for as much host time,
    because a client's keep-alive thread runs on the host's clock (``liveness_clock: both``).
    """

    serial_number: str = Field(default="spot-FAKE-00000001", min_length=1, max_length=64)
    nickname: str = Field(default="fake", max_length=64)
    software_version: tuple[int, int, int] = (5, 2, 0)

    operator_estop: bool = True
    """An operator holds a released e-stop endpoint at start, as the tablet of a real robot does. Without it the robot
    is stopped until a program registers an endpoint."""
    estop_cut_after_settle_s: float = Field(default=4.0, ge=0, le=60)
    """A silent endpoint first settles the robot; this much later it cuts power, unless the endpoint says otherwise."""

    lease_timeout_s: float = Field(default=6.0, gt=0, le=3600)
    """A lease that was neither used nor retained for this long is stale: its holder is refused, others may acquire."""
    on_lease_expiry: Literal["safe_power_off", "stop", "nothing"] = "safe_power_off"
    """What the robot does when its lease expires while the motors are on."""
    liveness_clock: Literal["both", "robot"] = "both"

    joint_control_license: Literal["valid", "expired", "missing"] = "valid"
    missing_license_refusal: Literal["unsupported", "invalid_request"] = "unsupported"
    """The status with which a joint request without a licence is refused."""

    token_lifetime_s: float = Field(default=12 * 3600.0, gt=0, le=30 * 86400)
    max_failed_logins: int = Field(default=10, ge=1)
    lockout_s: float = Field(default=30.0, ge=0, le=3600)
    """After ``max_failed_logins`` wrong passwords in a row, every login of that user is refused for this long."""

    time_sync_samples: int = Field(default=3, ge=1, le=25)
    """Round trips before the robot calls a client synchronised."""

    clock_identifier_check: Literal["every_command", "timed_commands", "none"] = "every_command"
    """Which robot commands are refused with NO_TIMESYNC unless they bear the identifier of a finished time sync: all,
    or those with an end time alone. The protos say that the identifier verifies time sync, not on which commands."""
    missing_end_time_refusal: Literal["expired", "invalid_request"] = "expired"
    """The status with which a timed command without an end time is refused."""
    max_command_duration_s: float = Field(default=600.0, gt=0, le=86400)
    """A robot command whose end time lies further ahead is TOO_DISTANT."""

    max_walking_speed_m_s: float = Field(default=1.6, gt=0, le=10)
    """Bound of the walking commands, forwards and to the side. Source: the vendor's data sheet."""
    max_turn_rate_rad_s: float = Field(default=2.0, gt=0, le=10)

    second_command_stream: Literal["refuse", "evict"] = "refuse"
    """What a second joint-control stream does while one is open."""
    max_command_rate_hz: float = Field(default=2000.0, gt=0)
    """A faster joint-control stream (mean over one second, real time only) is ended with INVALID_REQUEST."""

    cameras: Literal["scene", "test_card", "none"] = "scene"
    """What the image service has: cameras that see the simulated scene, and a test card where this computer cannot draw
    without a display; cameras with a test card before each; or no camera at all."""

    max_concurrent_calls: int = Field(default=64, ge=4, le=1024)
    max_message_bytes: int = Field(default=4 * 1024 * 1024, ge=1024)
    """A larger request is refused with RESOURCE_EXHAUSTED."""

    reboot_s: float = Field(default=5.0, ge=0, le=600)
    """How long the services are away after a power cycle or a reboot."""
