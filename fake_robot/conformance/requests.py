"""Requests whose answer is one status, each a row: what is sent, and what a robot answers. None gives power."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from typing import Any

from bosdyn.api import lease_pb2

from fake_robot.conformance.check import Basis, Check, Needs
from fake_robot.conformance.power import held
from fake_robot.conformance.server import CLIENT_NAME, SERVICES, Server, enum_name

Fields = dict[str, Any]
_LEASE, _ESTOP, _FAULT = "lease.proto", "estop.proto", "service_fault.proto"
_USED, _CODE = "lease_use_result.status", "header.error.code"
_NO_SUCH, _NO_NUMBER = "no-such-thing", 0xFFFFFFF0
OF_BEFORE = lease_pb2.Lease(resource="body", epoch="no-such-epoch", sequence=[1])
_OF_NOTHING = lease_pb2.Lease(resource=_NO_SUCH, epoch="e", sequence=[1])
_A_FAULT = {"fault_name": _NO_SUCH, "service_name": _NO_SUCH}
_TAKEN = {"name": "robot-state", "type": "bosdyn.api.RobotStateService", "authority": "robot-state.spot.robot"}
_USE = "RobotCommand.ClearBehaviorFault"


def _row(
    name: str,
    call: str,
    sends: str,
    fields: Fields,
    expects: str,
    source: str,
    *,
    field: str = "",
    told_in: str = "status",
    basis: Basis = Basis.DOCUMENTED,
) -> Check:
    """A request that needs nothing; ``call`` names service and method, ``field`` the part of it that is wrong."""

    def probe(server: Server) -> str:
        service, _, method = call.partition(".")
        return enum_name(server.ask(SERVICES[service], method, **fields), told_in)

    return Check(
        name, f"{call}: {field}" if field else call, sends, (expects,), basis, source, Needs.NOTHING, "", probe
    )


def _guess(name: str, call: str, fields: Fields, field: str) -> Check:
    source, code = "header.proto", "CODE_INVALID_REQUEST"
    return _row(name, call, "an unknown one", fields, code, source, field=field, told_in=_CODE, basis=Basis.GUESS)


def changed(lease: lease_pb2.Lease, **changes: object) -> lease_pb2.Lease:
    """A lease like another but for some of its fields."""
    return lease_pb2.Lease(
        **{"resource": lease.resource, "epoch": lease.epoch, "sequence": list(lease.sequence), **changes}
    )


def use(server: Server, lease: lease_pb2.Lease) -> str:
    """How a robot judges a lease in a command that changes nothing: clearing an unknown fault."""
    return enum_name(
        server.ask("robot-command", "ClearBehaviorFault", lease=lease, behavior_fault_id=_NO_NUMBER), _USED
    )


def _held(name: str, sends: str, make: Callable[[lease_pb2.Lease], lease_pb2.Lease], expects: str, field: str) -> Check:
    """A command with what is made of the lease that is held."""

    def probe(server: Server) -> str:
        with held(server) as lease:
            return use(server, make(lease))

    rpc = f"commands: lease{field}"
    return Check(name, rpc, sends, (expects,), Basis.DOCUMENTED, _LEASE, Needs.LEASE, "", probe)


ROWS = (
    _row(
        "wrong_password",
        "Auth.GetAuthToken",
        "a wrong password",
        {"username": CLIENT_NAME, "password": secrets.token_hex(8)},
        "STATUS_INVALID_LOGIN",
        "auth.proto",
        field="password",
    ),
    _row(
        "wrong_token", "Auth.GetAuthToken", "an unknown token", {"token": "none"}, "STATUS_INVALID_TOKEN", "auth.proto"
    ),
    _row(
        "unknown_service",
        "Directory.GetServiceEntry",
        "a name that no service has",
        {"service_name": _NO_SUCH},
        "STATUS_NONEXISTENT_SERVICE",
        "directory.proto",
    ),
    _row(
        "unregister_unknown",
        "DirectoryRegistration.UnregisterService",
        "a name that no service has",
        {"service_name": _NO_SUCH},
        "STATUS_NONEXISTENT_SERVICE",
        "directory_registration.proto",
    ),
    _row(
        "register_taken_name",
        "DirectoryRegistration.RegisterService",
        "the name of one of the robot's services",
        {"service_entry": _TAKEN},
        "STATUS_ALREADY_EXISTS",
        "directory_registration.proto",
    ),
    _row(
        "acquire_unknown_resource",
        "Lease.AcquireLease",
        "an unknown resource",
        {"resource": _NO_SUCH},
        "STATUS_INVALID_RESOURCE",
        _LEASE,
    ),
    _row(
        "return_old_lease",
        "Lease.ReturnLease",
        "a lease that is not the active one",
        {"lease": OF_BEFORE},
        "STATUS_NOT_ACTIVE_LEASE",
        _LEASE,
    ),
    _row(
        "return_unknown_resource",
        "Lease.ReturnLease",
        "an unknown resource",
        {"lease": _OF_NOTHING},
        "STATUS_INVALID_RESOURCE",
        _LEASE,
    ),
    _row(
        "retain_wrong_epoch",
        "Lease.RetainLease",
        "a lease of another epoch",
        {"lease": OF_BEFORE},
        "STATUS_WRONG_EPOCH",
        _LEASE,
        told_in=_USED,
    ),
    _row("empty_lease", _USE, "no lease", {}, "STATUS_INVALID_LEASE", _LEASE, field="lease", told_in=_USED),
    _row(
        "unmanaged_lease",
        _USE,
        "an unknown resource",
        {"lease": _OF_NOTHING},
        "STATUS_UNMANAGED",
        _LEASE,
        field="lease.resource",
        told_in=_USED,
    ),
    _held("wrong_epoch", "another epoch", lambda x: changed(x, epoch=_NO_SUCH), "STATUS_WRONG_EPOCH", ".epoch"),
    _held("granted_lease", "the lease that was granted", lambda x: x, "STATUS_OK", ""),
    _held(
        "older_lease",
        "an older sequence",
        lambda x: changed(x, sequence=[x.sequence[0] - 1]),
        "STATUS_OLDER",
        ".sequence",
    ),
    _row(
        "estop_wrong_config",
        "Estop.SetEstopConfig",
        "an unknown identifier",
        {"target_config_id": _NO_SUCH},
        "STATUS_INVALID_ID",
        _ESTOP,
        field="target_config_id",
    ),
    _row(
        "estop_register_elsewhere",
        "Estop.RegisterEstopEndpoint",
        "an unknown identifier",
        {"target_config_id": _NO_SUCH, "new_endpoint": {"name": "conformance", "role": "PDB_rooted"}},
        "STATUS_CONFIG_MISMATCH",
        _ESTOP,
        field="target_config_id",
    ),
    _row(
        "keepalive_unknown_policy",
        "Keepalive.CheckIn",
        "an unknown number",
        {"policy_id": _NO_NUMBER},
        "STATUS_INVALID_POLICY_ID",
        "keepalive.proto",
        field="policy_id",
    ),
    _guess("feedback_of_nothing", "RobotCommand.RobotCommandFeedback", {"robot_command_id": _NO_NUMBER}, "id"),
    _guess("unknown_link", "RobotState.GetRobotLinkModel", {"link_name": _NO_SUCH}, "link_name"),
    _row(
        "clear_unknown_service_fault",
        "Fault.ClearServiceFault",
        "a fault that is not active",
        {"fault_id": _A_FAULT},
        "STATUS_FAULT_NOT_ACTIVE",
        _FAULT,
    ),
    _row(
        "unknown_camera",
        "Image.GetImage",
        "an unknown camera",
        {"image_requests": [{"image_source_name": _NO_SUCH}]},
        "STATUS_UNKNOWN_CAMERA",
        "image.proto",
        told_in="image_responses.0.status",
    ),
    _row(
        "delete_unknown_object",
        "WorldObject.MutateWorldObjects",
        "the deletion of an unknown object",
        {"mutation": {"action": "ACTION_DELETE", "object": {"id": 0x7FFFFFF0}}},
        "STATUS_INVALID_MUTATION_ID",
        "world_object.proto",
    ),
    _row("no_mission", "Mission.GetState", "", {}, "STATUS_NONE", "mission.proto", told_in="state.status"),
)
