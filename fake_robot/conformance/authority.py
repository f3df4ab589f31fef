"""Checks of lease, e-stop and power, and of requests to any service whose answer is one status.

Those requests are rows: what is sent, and what a robot answers. None of them gives power.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

from bosdyn.api import lease_pb2

from fake_robot.conformance.check import Basis, ConformanceCheck, Needs, check
from fake_robot.conformance.power import has_power, held, require_off, stop
from fake_robot.conformance.server import CLIENT_NAME, OpenError, Server, SkippedError, enum_name, status_of

_USED = "lease_use_result.status"
_NO_SUCH, _NO_NUMBER = "no-such-thing", 0xFFFFFFF0
OF_BEFORE = lease_pb2.Lease(resource="body", epoch="no-such-epoch", sequence=[1])
_OF_NOTHING = lease_pb2.Lease(resource=_NO_SUCH, epoch="e", sequence=[1])
_TAKEN = {"name": "robot-state", "type": "bosdyn.api.RobotStateService", "authority": "robot-state.spot.robot"}


def _row(
    name: str,
    call: str,
    sends: str,
    expects: str,
    told_in: str = "status",
    *,
    needs: Needs = Needs.NOTHING,
    **fields: Any,
) -> ConformanceCheck:
    """A request with these fields, sent while the lease is held if it needs that.

    ``call`` is the service's name in the directory, the method, and what of it is judged.
    """
    service, method = call.partition(":")[0].split(".")

    def probe(server: Server) -> str:
        if service == "estop":  # a wrong one may stop somebody's robot
            require_off(server)
        with held(server) if needs is Needs.LEASE else nullcontext():
            return enum_name(server.ask(service, method, **fields), told_in)

    basis = Basis.GUESS if expects == "CODE_INVALID_REQUEST" else Basis.DOCUMENTED
    source = "header.proto" if basis is Basis.GUESS else f"{service.replace('-', '_')}.proto"
    return ConformanceCheck(name, call, sends, (expects,), basis, source, needs, "", probe)


def _guess(name: str, call: str, sends: str, **fields: Any) -> ConformanceCheck:
    return _row(name, call, sends, "CODE_INVALID_REQUEST", "header.error.code", **fields)


def _used(name: str, sends: str, expects: str, make: Callable[[lease_pb2.Lease], lease_pb2.Lease]) -> ConformanceCheck:
    """A command that changes nothing with what is made of the lease that is held."""

    def probe(server: Server) -> str:
        with held(server) as lease:
            return use(server, make(lease))

    return ConformanceCheck(
        name, "commands: lease", sends, (expects,), Basis.DOCUMENTED, "lease.proto", Needs.LEASE, "", probe
    )


def use(server: Server, lease: lease_pb2.Lease) -> str:
    """How a robot judges a lease in a command that changes nothing: clearing an unknown fault."""
    return enum_name(
        server.ask("robot-command", "ClearBehaviorFault", lease=lease, behavior_fault_id=_NO_NUMBER), _USED
    )


def changed(lease: lease_pb2.Lease, **changes: object) -> lease_pb2.Lease:
    """A lease like another but for some of its fields."""
    fields = {"resource": lease.resource, "epoch": lease.epoch, "sequence": list(lease.sequence)}
    return lease_pb2.Lease(**{**fields, **changes})


_LEASE, _ESTOP, _POWER = "lease.proto", "estop.proto", "power.proto"
_REFUSED, _AS_TOLD = "refused", "taken with power, refused without"


def _judged(used: str) -> str:
    return "accepted" if used == "STATUS_OK" else _REFUSED


@check("lease.AcquireLease: lease", "acquired twice, returned in between", "newer", source=_LEASE, needs=Needs.LEASE)
def new_lease_is_newer(server: Server) -> str:
    """The second lease has the epoch of the first and a greater sequence, and both are leases of the body."""
    with held(server) as lease:
        first = lease_pb2.Lease.FromString(lease.SerializeToString())
    with held(server) as second:
        if {first.resource, second.resource} != {"body"}:
            return f"leases of {first.resource} and {second.resource}"
        is_newer = first.epoch == second.epoch != "" and list(second.sequence) > list(first.sequence)
    return "newer" if is_newer else "not newer"


@check("lease.ListLeases", "", "all-leases, body over mobility", source=_LEASE)
def leases_form_a_tree(server: Server) -> str:
    """The resources of a robot without an arm, and which leases a lease contains."""

    def below(part: Any, *, is_inside: bool = False) -> set[str]:
        is_inside = is_inside or part.resource == "body"
        own = {part.resource} if is_inside else set()
        return own.union(*(below(sub, is_inside=is_inside) for sub in part.sub_resources))

    told = server.ask("lease", "ListLeases")
    missing = {"all-leases", "body", "mobility"} - {r.resource for r in told.resources}
    if missing:
        return f"no {', '.join(sorted(missing))}"
    return "all-leases, body over mobility" if "mobility" in below(told.resource_tree) else "no such tree"


@check("commands: lease", "one whose sub-lease was used", "STATUS_OLDER", source=_LEASE, needs=Needs.LEASE)
def lease_after_sublease(server: Server) -> str:
    """A command with a lease whose sub-lease was given on."""
    with held(server) as lease:
        first = use(server, changed(lease, sequence=[*lease.sequence, 1]))
        return use(server, lease) if first == "STATUS_OK" else f"the sub-lease: {first}"


@check("commands, Lease.RetainLease", "a lease that was returned", _REFUSED, source=_LEASE, needs=Needs.LEASE)
def returned_lease(server: Server) -> str:
    """A command with, and the retaining of, a lease that this client has given back."""
    with held(server) as lease:
        kept = lease_pb2.Lease.FromString(lease.SerializeToString())
    retained = enum_name(server.ask("lease", "RetainLease", lease=kept), "lease_use_result.status")
    return "accepted" if "accepted" in {_judged(use(server, kept)), _judged(retained)} else _REFUSED


@check("lease.TakeLease", "the lease before it was taken", _REFUSED, source=_LEASE, needs=Needs.LEASE)
def taken_lease(server: Server) -> str:
    """A command with a lease that somebody took, before and after the new one is used; here its own holder took it."""
    with held(server) as lease:
        taken = server.ask("lease", "TakeLease", resource="body").lease
        try:
            before = _judged(use(server, lease))
            use(server, taken)
            return before if before == "accepted" else _judged(use(server, lease))
        finally:
            server.ask("lease", "ReturnLease", lease=taken)


@check("lease.ListLeases: lease_owner", "while it is held", "its holder", source=_LEASE, needs=Needs.LEASE)
def owner_is_listed(server: Server) -> str:
    """The list names who holds the body, and nobody afterwards."""

    def owner() -> str:
        found = {r.resource: r for r in server.ask("lease", "ListLeases").resources}
        return str(found["body"].lease_owner.client_name) if "body" in found else ""

    with held(server):
        during = owner()
    if not during:
        return "nobody"
    return "its holder" if owner() != during else f"{during}, who returned it"


@check("commands: lease_use_result.attempted_lease", "a lease", "the same lease", source=_LEASE)
def attempted_lease_is_told(server: Server) -> str:
    """A lease that is refused comes back, so that a client with several knows which one it was."""
    told = server.ask("robot-command", "ClearBehaviorFault", lease=OF_BEFORE, behavior_fault_id=0xFFFFFFF0)
    return "the same lease" if told.lease_use_result.attempted_lease == OF_BEFORE else "another, or none"


@check("estop.GetEstopConfig, GetEstopSystemStatus", "", "the same endpoints", source=_ESTOP)
def estop_endpoints_agree(server: Server) -> str:
    """The configuration has an identifier, and the status speaks of its endpoints."""
    config = server.ask("estop", "GetEstopConfig").active_config
    status = server.ask("estop", "GetEstopSystemStatus").status
    if config.endpoints and not config.unique_id:
        return "the configuration has no identifier"
    configured, told = {e.unique_id for e in config.endpoints}, {e.endpoint.unique_id for e in status.endpoints}
    return "the same endpoints" if configured == told else f"{len(configured)} configured, {len(told)} told of"


@check("estop.GetEstopSystemStatus: stop_level", "", "the most restrictive", source=_ESTOP)
def estop_is_the_most_restrictive(server: Server) -> str:
    """The system's level is no milder than any endpoint's, and that of the software e-stop which the state reports."""
    status = server.ask("estop", "GetEstopSystemStatus").status
    level = enum_name(status, "stop_level")
    if not status.stop_level or status.stop_level > min((e.stop_level or 4 for e in status.endpoints), default=4):
        return f"{level}, milder than an endpoint's"
    told = {e.state == e.STATE_ESTOPPED for e in server.state().estop_states if e.type == e.TYPE_SOFTWARE}
    is_other = bool(told) and (level != "ESTOP_LEVEL_NONE") not in told
    return f"{level}, the state says otherwise" if is_other else "the most restrictive"


@check("estop.EstopCheckIn: endpoint", "an unknown endpoint", "STATUS_ENDPOINT_UNKNOWN", source=_ESTOP)
def estop_unknown_endpoint(server: Server) -> str:
    """Check in without having registered, for the level that the robot has, so that nothing changes."""
    require_off(server)
    level = server.ask("estop", "GetEstopSystemStatus").status.stop_level
    unknown = {"unique_id": "no-such-endpoint", "role": "PDB_rooted"}
    return status_of(server.ask("estop", "EstopCheckIn", stop_level=level, endpoint=unknown))


@check("estop.EstopCheckIn", "wrong responses", "STATUS_INCORRECT_CHALLENGE_RESPONSE", source=_ESTOP)
def estop_wrong_response(server: Server) -> str:
    """Check in for each endpoint, at its level, to no challenge, then to its challenge; motors off."""
    require_off(server)
    seen = []
    for told in server.ask("estop", "GetEstopSystemStatus").status.endpoints:
        known, challenge = {"stop_level": told.stop_level, "endpoint": told.endpoint}, 1
        for _ in range(2):
            answer = server.ask("estop", "EstopCheckIn", challenge=challenge, response=challenge, **known)
            seen.append(status_of(answer))
            challenge = answer.challenge
    registered = [status for status in seen if status != "STATUS_ENDPOINT_UNKNOWN"]
    if not registered:
        raise OpenError("no e-stop endpoint is registered; register one, then check again")
    return max(registered, key=lambda status: status != "STATUS_INCORRECT_CHALLENGE_RESPONSE")


@check("motor_power_state", "a stop", _AS_TOLD, source="robot_command.proto: NOT_POWERED_ON", needs=Needs.LEASE)
def power_is_as_told(server: Server) -> str:
    """A stop, which moves nothing, is refused for want of power where the state says that the motors are off."""
    with held(server) as lease:
        seen, is_on = stop(server, lease), has_power(server.state())
    if seen not in {"STATUS_OK", "STATUS_NOT_POWERED_ON"}:
        raise OpenError(f"a stop was answered by {seen}")
    if (seen == "STATUS_NOT_POWERED_ON") != is_on:
        return _AS_TOLD
    return f"the motors are told to be {'on' if is_on else 'off'}, a stop was answered by {seen}"


@check("power.PowerCommand", "motors on, the e-stop pressed", "STATUS_ESTOPPED", source=_POWER, needs=Needs.MOTION)
def power_while_stopped(server: Server) -> str:
    """Only where the robot is stopped already: no check presses or releases a stop."""
    if enum_name(server.ask("estop", "GetEstopSystemStatus").status, "stop_level") == "ESTOP_LEVEL_NONE":
        raise SkippedError("the e-stop is released, and no check presses it")
    with held(server) as lease:
        return status_of(server.ask("power", "PowerCommand", lease=lease, request="REQUEST_ON_MOTORS"))


@check("power.PowerCommandFeedback", "an unknown number", "no success", source=_POWER, needs=Needs.MOTION)
def power_feedback_of_nothing(server: Server) -> str:
    """Ask after a command that was never given; what it is refused with, no proto says."""
    seen = status_of(server.ask("power", "PowerCommandFeedback", power_command_id=0xFFFFFFF0))
    return seen if seen == "STATUS_SUCCESS" else "no success"


# fmt: off
ROWS = (
    _row("acquire_twice", "lease.AcquireLease", "one that is held", "STATUS_RESOURCE_ALREADY_CLAIMED",
         needs=Needs.LEASE, resource="body"),
    _row("power_without_lease", "power.PowerCommand: lease", "motors on, no lease", "STATUS_INVALID_LEASE", _USED,
         needs=Needs.MOTION, request="REQUEST_ON_MOTORS"),
    _row("wrong_password", "auth.GetAuthToken", "a wrong password", "STATUS_INVALID_LOGIN", username=CLIENT_NAME,
         password=secrets.token_hex(8)),
    _row("wrong_token", "auth.GetAuthToken", "an unknown token", "STATUS_INVALID_TOKEN", token="x"),  # noqa: S106
    _row("unknown_service", "directory.GetServiceEntry", "no service's name", "STATUS_NONEXISTENT_SERVICE",
         service_name=_NO_SUCH),
    _row("unregister_unknown", "directory-registration.UnregisterService", "no service's name",
         "STATUS_NONEXISTENT_SERVICE", service_name=_NO_SUCH),
    _row("register_taken_name", "directory-registration.RegisterService", "the name of one of the robot's services",
         "STATUS_ALREADY_EXISTS", service_entry=_TAKEN),
    _row("acquire_unknown_resource", "lease.AcquireLease", "an unknown resource", "STATUS_INVALID_RESOURCE",
         resource=_NO_SUCH),
    _row("return_old_lease", "lease.ReturnLease", "not the active one", "STATUS_NOT_ACTIVE_LEASE", lease=OF_BEFORE),
    _row("return_unknown_resource", "lease.ReturnLease", "an unknown resource", "STATUS_INVALID_RESOURCE",
         lease=_OF_NOTHING),
    _row("retain_wrong_epoch", "lease.RetainLease", "another epoch", "STATUS_WRONG_EPOCH", _USED, lease=OF_BEFORE),
    _used("empty_lease", "no lease", "STATUS_INVALID_LEASE", lambda _: lease_pb2.Lease()),
    _used("unmanaged_lease", "an unknown resource", "STATUS_UNMANAGED", lambda _: _OF_NOTHING),
    _used("wrong_epoch", "another epoch", "STATUS_WRONG_EPOCH", lambda x: changed(x, epoch=_NO_SUCH)),
    _used("granted_lease", "the lease that was granted", "STATUS_OK", lambda x: x),
    _used("older_lease", "an older sequence", "STATUS_OLDER", lambda x: changed(x, sequence=[x.sequence[0] - 1])),
    _row("estop_wrong_config", "estop.SetEstopConfig", "an unknown target", "STATUS_INVALID_ID",
         target_config_id=_NO_SUCH),
    _row("estop_register_elsewhere", "estop.RegisterEstopEndpoint", "an unknown target", "STATUS_CONFIG_MISMATCH",
         target_config_id=_NO_SUCH, new_endpoint={"name": "conformance", "role": "PDB_rooted"}),
    _row("keepalive_unknown_policy", "keepalive.CheckIn", "an unknown number", "STATUS_INVALID_POLICY_ID",
         policy_id=_NO_NUMBER),
    _guess("feedback_of_nothing", "robot-command.RobotCommandFeedback", "an unknown number",
           robot_command_id=_NO_NUMBER),
    _guess("unknown_link", "robot-state.GetRobotLinkModel", "an unknown link", link_name=_NO_SUCH),
    _row("clear_unknown_fault", "fault.ClearServiceFault", "a fault that is not active", "STATUS_FAULT_NOT_ACTIVE",
         fault_id={"fault_name": _NO_SUCH, "service_name": _NO_SUCH}),
    _row("unknown_camera", "image.GetImage", "an unknown camera", "STATUS_UNKNOWN_CAMERA", "image_responses.0.status",
         image_requests=[{"image_source_name": _NO_SUCH}]),
    _row("delete_unknown_object", "world-objects.MutateWorldObjects", "an unknown number", "STATUS_INVALID_MUTATION_ID",
         mutation={"action": "ACTION_DELETE", "object": {"id": 0x7FFFFFF0}}),
    _row("no_mission", "robot-mission.GetState", "no mission loaded", "STATUS_NONE", "state.status"),
)
# fmt: on
