"""The SDK's and gRPC's errors, turned into ours: what is in the way, and what to do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import grpc
from bosdyn.client import auth, estop, lease, power, robot_command
from bosdyn.client import exceptions as sdk
from bosdyn.client.robot import UnregisteredServiceError

from spot_runtime.causes import shortage
from spot_runtime.hal.errors import (
    ClockError,
    CredentialsError,
    EstopError,
    FaultError,
    HalError,
    LeaseHeldError,
    LicenseError,
    MotionError,
    NoServiceError,
)

SDK_ERRORS = (sdk.Error, lease.Error, grpc.RpcError)
"""What a call raises; the SDK's errors of its lease wallet are no others of its errors."""

NO_CONNECTION = (grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.DEADLINE_EXCEEDED, grpc.StatusCode.UNIMPLEMENTED)
"""What a call ends with where no robot answers. The SDK's own classes cannot tell: they are chosen by numbers found in
gRPC's text, so an unreachable robot at port 42909 raises ``TooManyRequestsError`` for the 429 in it."""


def translate(error: Exception, doing: str, explain_connection: Callable[[str], HalError] | None = None) -> HalError:
    """Our error for what the SDK or gRPC raised while ``doing`` something, such as "taking the lease".

    ``explain_connection`` finds out why there is no connection, given the SDK's words; None where that is not asked.
    """
    if isinstance(error, HalError):
        return error
    if lacks := shortage(describe_error(error)):
        return HalError(f"{doing}: {lacks} ({describe_error(error)})")
    if isinstance(error, sdk.RpcError):
        if explain_connection is not None and code_of(error) in NO_CONNECTION:
            return explain_connection(describe_error(error))
        if code_of(error) in (grpc.StatusCode.UNAUTHENTICATED, grpc.StatusCode.PERMISSION_DENIED):
            return CredentialsError(
                f"{doing}: the robot denies access ({describe_error(error)}); check the user's rights"
            )
        if isinstance(error, sdk.UnimplementedError):
            return HalError(
                f"{doing}: the robot has no such call ({describe_error(error)}); its software may be too old"
            )
        return HalError(f"{doing}: the robot did not answer ({describe_error(error)}); check the link")
    if isinstance(error, lease.ResourceAlreadyClaimedError):
        return _lease_held(error)
    for kinds, ours, advice in _TABLE:
        if isinstance(error, kinds):
            return ours(f"{doing}: {describe_error(error)}; {advice}")
    return HalError(f"{doing}: {describe_error(error)}")


def describe_error(error: Exception) -> str:
    """What an error of the SDK or gRPC says, on one line, without the request's content."""
    if isinstance(error, sdk.RpcError):
        text = _details(error.error)
    elif isinstance(error, grpc.RpcError):
        text = _details(error)
    elif isinstance(error, sdk.ResponseError):
        said = (error.error_message or type(error).__doc__ or "").rstrip(".")
        text = f"{type(error).__name__}: {said}" + _details_of_answer(error)
    else:
        text = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return " ".join(text.split())


def _lease_held(error: lease.ResourceAlreadyClaimedError) -> LeaseHeldError:
    who = _named(error.response.lease_owner) or "an unnamed client"
    return LeaseHeldError(
        f"the lease is held by {who}; it is never taken by force: release it there (or on the tablet), then start again"
    )


def _named(owner: Any) -> str:
    return " / ".join(name for name in (owner.client_name, owner.user_name) if name)


def enum_word(enum: Any, number: int, prefix: str = "") -> str:
    """The name of a value without its prefix, in lower case if it has one; its number if it is newer than our API."""
    value = enum.DESCRIPTOR.values_by_number.get(number)
    name = f"value {number} of newer software" if value is None else str(value.name)
    return name.removeprefix(prefix).lower() if prefix else name


def code_of(error: Exception) -> grpc.StatusCode | None:
    """The code of a call's error, given gRPC's or the SDK's around it; None if it has none."""
    code = getattr(getattr(error, "error", error), "code", None)
    return code() if callable(code) else None


def _details(error: Any) -> str:
    """Code and details of a gRPC error; those that a call raises have both, though their type does not say so."""
    code, details = getattr(error, "code", None), getattr(error, "details", None)
    return f"{code().name}: {details()}" if callable(code) and callable(details) else str(error)


def _details_of_answer(error: sdk.ResponseError) -> str:
    """What an answer names: who has the lease, the faults in the way, what the robot adds."""
    holder = _named(error.lease_use_result.owner) if isinstance(error, sdk.LeaseUseError) else ""
    names = [fault.name for fault in getattr(error.response, "blocking_faults", ())]
    told = (holder and f"held by {holder}", ", ".join(names), getattr(error.response, "message", ""))
    return "".join(f" ({words})" for words in told if words)


_TABLE: tuple[tuple[tuple[type[Exception], ...], type[HalError], str], ...] = (
    ((auth.TemporarilyLockedOutError,), CredentialsError, "too many logins failed: wait some minutes, then try again"),
    ((auth.AuthResponseError,), CredentialsError, "check user name and password"),
    ((sdk.LicenseError,), LicenseError, "ask the vendor for a licence with joint control"),
    (
        (UnregisteredServiceError, lease.InvalidResourceError),
        NoServiceError,
        "the robot does not offer it; its software may be too old",
    ),
    ((lease.LeaseResponseError, lease.Error, sdk.LeaseUseError), LeaseHeldError, "see who holds the lease"),
    ((estop.MotorsOnError,), EstopError, "have the robot sit and power off (on the tablet), then start again"),
    ((power.EstoppedError, estop.EstopResponseError), EstopError, "release every e-stop, then start again"),
    ((power.ShorePowerConnectedError,), FaultError, "unplug it or have it leave its dock, then start again"),
    ((robot_command.DockedError,), MotionError, "have it leave its dock (on the tablet), then start again"),
    ((power.FaultedError, power.BatteryMissingError), FaultError, "clear the cause on the robot's own page"),
    (
        (power.KeepaliveMotorsOffError,),
        MotionError,
        "have the program that set this keepalive policy check in, or remove the policy",
    ),
    ((robot_command.BehaviorFaultError,), FaultError, "clear the behaviour fault on the tablet"),
    (
        (robot_command.NoTimeSyncError, robot_command.ExpiredError, robot_command.TooDistantError),
        ClockError,
        "check the clocks",
    ),
    ((power.PowerResponseError, robot_command.RobotCommandResponseError), MotionError, "see the robot's own page"),
)
