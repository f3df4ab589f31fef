"""Checks of lease, e-stop, power, licence and keep-alive."""

from __future__ import annotations

from bosdyn.api import estop_pb2, lease_pb2

from fake_robot.conformance.check import Basis, Needs, check
from fake_robot.conformance.server import RPC_TIMEOUT_S, Server, SkippedError, enum_name, status_of

_LEASE = "lease.proto"
_ESTOP = "estop.proto"
_OLD = lease_pb2.Lease(resource="body", epoch="no-such-epoch", sequence=[1])
_OF_NOTHING = lease_pb2.Lease(resource="no-such-resource", epoch="e", sequence=[1])


def use_lease(server: Server, lease: lease_pb2.Lease) -> str:
    """How a robot judges a lease in a command that changes nothing: clearing an unknown fault."""
    answer = server.ask("robot-command", "ClearBehaviorFault", lease=lease, behavior_fault_id=0xFFFFFFF0)
    return status_of(answer.lease_use_result)


def _changed(lease: lease_pb2.Lease, **changes: object) -> lease_pb2.Lease:
    return lease_pb2.Lease(
        **{"resource": lease.resource, "epoch": lease.epoch, "sequence": list(lease.sequence), **changes}
    )


@check("Lease.AcquireLease: resource", "an unknown resource", "STATUS_INVALID_RESOURCE", source=_LEASE)
def acquire_unknown_resource(server: Server) -> str:
    """Acquire what cannot be owned."""
    return status_of(server.ask("lease", "AcquireLease", resource="no-such-resource"))


@check(
    "Lease.AcquireLease",
    "a resource that somebody holds",
    "STATUS_RESOURCE_ALREADY_CLAIMED",
    source=_LEASE,
    needs=Needs.LEASE,
)
def acquire_twice(server: Server) -> str:
    """Acquire the lease while it is held."""
    with server.lease():
        return status_of(server.ask("lease", "AcquireLease", resource="body"))


@check("Lease.ReturnLease: lease", "a lease that is not the active one", "STATUS_NOT_ACTIVE_LEASE", source=_LEASE)
def return_old_lease(server: Server) -> str:
    """Return a lease of another epoch."""
    return status_of(server.ask("lease", "ReturnLease", lease=_OLD))


@check("Lease.ReturnLease: resource", "an unknown resource", "STATUS_INVALID_RESOURCE", source=_LEASE)
def return_unknown_resource(server: Server) -> str:
    """Return what cannot be owned."""
    return status_of(server.ask("lease", "ReturnLease", lease=_OF_NOTHING))


@check("Lease.ListLeases", "", "all-leases, body, mobility", source="SDK: Understanding Spot Programming")
def leases_are_listed(server: Server) -> str:
    """The resources of a robot without an arm."""
    wanted = {"all-leases", "body", "mobility"}
    return ", ".join(sorted(wanted & {r.resource for r in server.ask("lease", "ListLeases").resources}))


@check("commands: lease", "no lease", "STATUS_INVALID_LEASE", source=_LEASE)
def empty_lease(server: Server) -> str:
    """A command without a lease."""
    return use_lease(server, lease_pb2.Lease())


@check("commands: lease.resource", "an unknown resource", "STATUS_UNMANAGED", source=_LEASE)
def unmanaged_lease(server: Server) -> str:
    """A command with a lease of something else."""
    return use_lease(server, _OF_NOTHING)


@check("commands: lease.epoch", "another epoch", "STATUS_WRONG_EPOCH", source=_LEASE, needs=Needs.LEASE)
def wrong_epoch(server: Server) -> str:
    """A command with a lease from before a reboot."""
    with server.lease() as lease:
        return use_lease(server, _changed(lease, epoch="no-such-epoch"))


@check("commands: lease.sequence", "the lease that was granted", "STATUS_OK", source=_LEASE, needs=Needs.LEASE)
def granted_lease(server: Server) -> str:
    """A command with a good lease."""
    with server.lease() as lease:
        return use_lease(server, lease)


@check("commands: lease.sequence", "an older sequence", "STATUS_OLDER", source=_LEASE, needs=Needs.LEASE)
def older_lease(server: Server) -> str:
    """A command with the lease of an earlier holder."""
    with server.lease() as lease:
        return use_lease(server, _changed(lease, sequence=[lease.sequence[0] - 1]))


@check(
    "commands: lease.sequence",
    "the lease itself after its sub-lease was used",
    "STATUS_OLDER",
    source="lease.proto: sub-leases are newer",
    needs=Needs.LEASE,
)
def lease_after_sublease(server: Server) -> str:
    """A command with a lease whose sub-lease was given on."""
    with server.lease() as lease:
        sub = _changed(lease, sequence=[*lease.sequence, 1])
        first = use_lease(server, sub)
        return use_lease(server, lease) if first == "STATUS_OK" else f"the sub-lease: {first}"


@check("Lease.RetainLease: lease", "a lease of another epoch", "STATUS_WRONG_EPOCH", source=_LEASE)
def retain_wrong_epoch(server: Server) -> str:
    """Retain a lease from before a reboot."""
    return status_of(server.ask("lease", "RetainLease", lease=_OLD).lease_use_result)


@check("Estop.SetEstopConfig: target_config_id", "an unknown identifier", "STATUS_INVALID_ID", source=_ESTOP)
def estop_wrong_config(server: Server) -> str:
    """Replace a configuration that is not the active one."""
    return status_of(server.ask("estop", "SetEstopConfig", target_config_id="no-such-config"))


@check(
    "Estop.RegisterEstopEndpoint: target_config_id",
    "an unknown identifier",
    "STATUS_CONFIG_MISMATCH",
    source=_ESTOP,
)
def estop_register_elsewhere(server: Server) -> str:
    """Register in a configuration that is not the active one."""
    new = {"name": "conformance", "role": "PDB_rooted"}
    answer = server.ask("estop", "RegisterEstopEndpoint", target_config_id="no-such-config", new_endpoint=new)
    return status_of(answer)


@check("Estop.GetEstopSystemStatus: stop_level", "", "the most restrictive", source=_ESTOP)
def estop_is_the_most_restrictive(server: Server) -> str:
    """The system's level is no milder than any endpoint's, and that of the software e-stop which the state reports."""
    status, none = server.ask("estop", "GetEstopSystemStatus").status, estop_pb2.ESTOP_LEVEL_NONE
    if not status.stop_level or status.stop_level > min((e.stop_level or none for e in status.endpoints), default=none):
        return f"{enum_name(status, 'stop_level')}, milder than an endpoint's"
    told = {e.state == e.STATE_ESTOPPED for e in server.state().estop_states if e.type == e.TYPE_SOFTWARE}
    is_other = bool(told) and (status.stop_level != none) not in told
    return f"{enum_name(status, 'stop_level')}, the state says otherwise" if is_other else "the most restrictive"


@check("Estop.EstopCheckIn: endpoint", "an unknown endpoint", "STATUS_ENDPOINT_UNKNOWN", source=_ESTOP)
def estop_unknown_endpoint(server: Server) -> str:
    """Check in without having registered."""
    unknown = {"unique_id": "no-such-endpoint", "role": "PDB_rooted"}
    return status_of(server.ask("estop", "EstopCheckIn", stop_level="ESTOP_LEVEL_NONE", endpoint=unknown))


@check("Power.PowerCommand: lease", "no lease", "STATUS_INVALID_LEASE", source="power.proto: lease_use_result")
def power_without_lease(server: Server) -> str:
    """Motors on, without a lease."""
    return status_of(server.ask("power", "PowerCommand", request="REQUEST_ON_MOTORS").lease_use_result)


@check(
    "Power.PowerCommand",
    "motors on, with the e-stop pressed",
    "STATUS_ESTOPPED",
    source="power.proto",
    needs=Needs.LEASE,
)
def power_while_stopped(server: Server) -> str:
    """Only where the robot is stopped already: no check presses or releases a stop."""
    if not server.robot.is_estopped(timeout=RPC_TIMEOUT_S):
        raise SkippedError("the e-stop is released")
    with server.lease() as lease:
        return status_of(server.ask("power", "PowerCommand", lease=lease, request="REQUEST_ON_MOTORS"))


@check(
    "Power.PowerCommandFeedback: power_command_id",
    "an unknown number",
    "CODE_INVALID_REQUEST",
    basis=Basis.GUESS,
    source="header.proto",
)
def power_feedback_of_nothing(server: Server) -> str:
    """Ask after a command that was never given."""
    answer = server.ask("power", "PowerCommandFeedback", power_command_id=0xFFFFFFF0)
    return enum_name(answer.header.error, "code")


@check("Keepalive.CheckIn: policy_id", "an unknown number", "STATUS_INVALID_POLICY_ID", source="keepalive.proto")
def keepalive_unknown_policy(server: Server) -> str:
    """Check in for an unknown policy."""
    return status_of(server.ask("keepalive", "CheckIn", policy_id=0xFFFFFFF0))
