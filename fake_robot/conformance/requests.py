"""Requests whose answer is one status, each a row: what is sent, and what a robot answers. None gives power."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from typing import Any

from bosdyn.api import lease_pb2

from fake_robot.conformance.check import Basis, Check, Needs
from fake_robot.conformance.power import held, require_off
from fake_robot.conformance.server import CLIENT_NAME, Server, enum_name

_USED = "lease_use_result.status"
_NO_SUCH, _NO_NUMBER = "no-such-thing", 0xFFFFFFF0
OF_BEFORE = lease_pb2.Lease(resource="body", epoch="no-such-epoch", sequence=[1])
_OF_NOTHING = lease_pb2.Lease(resource=_NO_SUCH, epoch="e", sequence=[1])
_A_FAULT = {"fault_name": _NO_SUCH, "service_name": _NO_SUCH}
_TAKEN = {"name": "robot-state", "type": "bosdyn.api.RobotStateService", "authority": "robot-state.spot.robot"}
_ENDPOINT = {"name": "conformance", "role": "PDB_rooted"}
_DELETION = {"action": "ACTION_DELETE", "object": {"id": 0x7FFFFFF0}}


def _row(name: str, call: str, sends: str, expects: str, told_in: str = "status", **fields: Any) -> Check:
    """A request with these fields; ``call`` is the service's name in the directory, and the method."""

    def probe(server: Server) -> str:
        service, _, method = call.partition(".")
        if service == "estop":  # a wrong one may stop somebody's robot
            require_off(server)
        return enum_name(server.ask(service, method, **fields), told_in)

    basis = Basis.GUESS if expects == "CODE_INVALID_REQUEST" else Basis.DOCUMENTED
    source = "header.proto" if basis is Basis.GUESS else f"{call.partition('.')[0].replace('-', '_')}.proto"
    return Check(name, call, sends, (expects,), basis, source, Needs.NOTHING, "", probe)


def _guess(name: str, call: str, sends: str, **fields: Any) -> Check:
    return _row(name, call, sends, "CODE_INVALID_REQUEST", "header.error.code", **fields)


def _used(name: str, sends: str, expects: str, make: Callable[[lease_pb2.Lease], lease_pb2.Lease]) -> Check:
    """A command that changes nothing with what is made of the lease that is held."""

    def probe(server: Server) -> str:
        with held(server) as lease:
            return use(server, make(lease))

    return Check(name, "commands: lease", sends, (expects,), Basis.DOCUMENTED, "lease.proto", Needs.LEASE, "", probe)


def use(server: Server, lease: lease_pb2.Lease) -> str:
    """How a robot judges a lease in a command that changes nothing: clearing an unknown fault."""
    return enum_name(
        server.ask("robot-command", "ClearBehaviorFault", lease=lease, behavior_fault_id=_NO_NUMBER), _USED
    )


def changed(lease: lease_pb2.Lease, **changes: object) -> lease_pb2.Lease:
    """A lease like another but for some of its fields."""
    fields = {"resource": lease.resource, "epoch": lease.epoch, "sequence": list(lease.sequence)}
    return lease_pb2.Lease(**{**fields, **changes})


# fmt: off
ROWS = (
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
         target_config_id=_NO_SUCH, new_endpoint=_ENDPOINT),
    _row("keepalive_unknown_policy", "keepalive.CheckIn", "an unknown number", "STATUS_INVALID_POLICY_ID",
         policy_id=_NO_NUMBER),
    _guess("feedback_of_nothing", "robot-command.RobotCommandFeedback", "an unknown number",
           robot_command_id=_NO_NUMBER),
    _guess("unknown_link", "robot-state.GetRobotLinkModel", "an unknown link", link_name=_NO_SUCH),
    _row("clear_unknown_fault", "fault.ClearServiceFault", "a fault that is not active", "STATUS_FAULT_NOT_ACTIVE",
         fault_id=_A_FAULT),
    _row("unknown_camera", "image.GetImage", "an unknown camera", "STATUS_UNKNOWN_CAMERA", "image_responses.0.status",
         image_requests=[{"image_source_name": _NO_SUCH}]),
    _row("delete_unknown_object", "world-objects.MutateWorldObjects", "an unknown number", "STATUS_INVALID_MUTATION_ID",
         mutation=_DELETION),
    _row("no_mission", "robot-mission.GetState", "no mission loaded", "STATUS_NONE", "state.status"),
)
# fmt: on
