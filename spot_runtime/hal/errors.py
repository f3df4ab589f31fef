"""What can be in the way of driving a robot, each with its own words and exit code."""

from __future__ import annotations

from spot_model.errors import SpotRlError


class HalError(SpotRlError):
    """The robot cannot be used."""

    label = "robot_error"
    exit_code = 80


class NoRobotError(HalError):
    """Nothing answers at the address."""

    label = "no_robot"
    exit_code = 81


class CertificateError(HalError):
    """The certificate that was presented is not trusted."""

    label = "certificate_not_trusted"
    exit_code = 82


class CredentialsError(HalError):
    """User name or password is missing, unsafe or wrong."""

    label = "credentials_refused"
    exit_code = 83


class LeaseHeldError(HalError):
    """Another client holds the lease."""

    label = "lease_held"
    exit_code = 84


class EstopError(HalError):
    """An e-stop is pressed, or none is set up."""

    label = "estop_pressed"
    exit_code = 85


class FaultError(HalError):
    """The robot reports a fault, or its battery is low or unknown."""

    label = "robot_fault"
    exit_code = 86


class LicenseError(HalError):
    """Joint control is not licensed."""

    label = "license_missing"
    exit_code = 87


class ClockError(HalError):
    """The clocks cannot be synchronised."""

    label = "clock_not_synced"
    exit_code = 88


class MotionError(HalError):
    """Powering on, standing, sitting or powering off did not succeed."""

    label = "motion_failed"
    exit_code = 89


class LockStepError(HalError):
    """The fake robot's lock-step failed."""

    label = "lock_step_failed"
    exit_code = 90


class NoServiceError(HalError):
    """The robot lacks a required service."""

    label = "no_service"
    exit_code = 91
