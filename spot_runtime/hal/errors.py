"""What can be in the way of driving a robot, each with its own words and exit code."""

from __future__ import annotations

from spot_model.errors import SpotRlError


class HalError(SpotRlError):
    """The robot cannot be used."""

    exit_code = 80


class NoRobotError(HalError):
    """Nothing answers at the address."""

    exit_code = 81


class CertificateError(HalError):
    """The certificate that was presented is not trusted."""

    exit_code = 82


class CredentialsError(HalError):
    """User name or password is missing, unsafe or wrong."""

    exit_code = 83


class LeaseHeldError(HalError):
    """Somebody else holds the lease."""

    exit_code = 84


class EstopError(HalError):
    """An e-stop is pressed, or none is set up."""

    exit_code = 85


class FaultError(HalError):
    """The robot reports a fault, or its battery is low."""

    exit_code = 86


class LicenseError(HalError):
    """Joint control is not licensed."""

    exit_code = 87


class ClockError(HalError):
    """The clocks cannot be brought together."""

    exit_code = 88


class MotionError(HalError):
    """Powering on, standing, sitting or powering off did not succeed."""

    exit_code = 89


class LockStepError(HalError):
    """The fake robot's lock-step does not do what was asked."""

    exit_code = 90
