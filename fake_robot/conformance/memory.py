"""Checks of what a robot remembers: what was put in comes out, and what was given back is gone."""

from __future__ import annotations

from typing import Any

from bosdyn.api import image_pb2, lease_pb2, world_object_pb2

from fake_robot.conformance.authority import use_lease
from fake_robot.conformance.check import Needs, check
from fake_robot.conformance.server import RPC_TIMEOUT_S, Server, SkippedError

_LEASE = "lease.proto"
_KEPT = "listed, then gone"
_TRIAL = "spot-rl-conformance-trial"


def _refusal(used: str) -> str:
    return "accepted" if used == "STATUS_OK" else "refused"


@check("commands: lease", "a lease that was returned", "refused", source=_LEASE, needs=Needs.LEASE)
def returned_lease(server: Server) -> str:
    """A command with a lease that this client has given back."""
    with server.lease() as lease:
        kept = lease_pb2.Lease.FromString(lease.SerializeToString())
    return _refusal(use_lease(server, kept))


@check("Lease.TakeLease", "the lease before it was taken", "refused", source=_LEASE, needs=Needs.LEASE)
def taken_lease(server: Server) -> str:
    """A command with a lease that somebody took, before and after the new one is used; here its own holder took it."""
    with server.lease() as lease:
        taken = server.ask("lease", "TakeLease", resource="body").lease
        try:
            before = _refusal(use_lease(server, lease))
            use_lease(server, taken)
            return before if before == "accepted" else _refusal(use_lease(server, lease))
        finally:
            server.ask("lease", "ReturnLease", lease=taken)


@check("Lease.AcquireLease: lease", "acquired twice, returned in between", "newer", source=_LEASE, needs=Needs.LEASE)
def new_lease_is_newer(server: Server) -> str:
    """The second lease has the epoch of the first and a greater sequence, and both are leases of the body."""
    with server.lease() as lease:
        first = lease_pb2.Lease.FromString(lease.SerializeToString())
    with server.lease() as second:
        if {first.resource, second.resource} != {"body"}:
            return f"leases of {first.resource} and {second.resource}"
        is_newer = first.epoch == second.epoch != "" and list(second.sequence) > list(first.sequence)
    return "newer" if is_newer else "not newer"


@check("Lease.ListLeases: lease_owner", "while it is held", "its holder", source=_LEASE, needs=Needs.LEASE)
def owner_is_listed(server: Server) -> str:
    """The list names who holds the body, and nobody afterwards."""

    def owner() -> str:
        found = {r.resource: r for r in server.robot.ensure_client("lease").list_leases()}
        return str(found["body"].lease_owner.client_name) if "body" in found else ""

    with server.lease():
        held = owner()
    if not held.startswith(server.robot.client_name):
        return f"{held or 'nobody'}"
    return "its holder" if not owner() else f"{owner()}, who returned it"


@check("Directory.ListServiceEntries: type", "", "those of the SDK", source="SDK: service types of its clients")
def types_are_the_sdks(server: Server) -> str:
    """Each service for which the SDK has a client is of that client's type, under some authority."""
    listed = {entry.name: entry for entry in server.robot.ensure_client("directory").list()}
    wrong = [
        client.default_service_name
        for client in server.robot.service_client_factories_by_type.values()
        if (entry := listed.get(client.default_service_name)) is not None
        and not (entry.type == client.service_type and entry.authority)
    ]
    return f"wrong: {', '.join(wrong)}" if wrong else "those of the SDK"


@check("Directory.GetServiceEntry", "robot-state", "as listed", source="directory.proto")
def entry_is_as_listed(server: Server) -> str:
    """One entry, looked up and listed."""
    found = server.ask("directory", "GetServiceEntry", service_name="robot-state").service_entry
    listed = {entry.name: entry for entry in server.robot.ensure_client("directory").list()}["robot-state"]
    same = (found.name, found.type, found.authority) == (listed.name, listed.type, listed.authority)
    return "as listed" if same else f"{found.name or 'nothing'}, {found.type}"


@check("DirectoryRegistration", "a service, then nothing", _KEPT, source="directory_registration.proto")
def registration_is_kept(server: Server) -> str:
    """Register a service of nothing, and unregister it."""
    server.require("directory-registration")
    client, directory = server.robot.ensure_client("directory-registration"), server.robot.ensure_client("directory")
    client.register(_TRIAL, "spot_rl.NoService", "no-service.spot.robot", "127.0.0.1", 1)
    try:
        was_listed = _TRIAL in {entry.name for entry in directory.list()}
    finally:
        client.unregister(_TRIAL)
    return _kept(was_listed, _TRIAL in {entry.name for entry in directory.list()})


@check("WorldObject.MutateWorldObjects", "an object, then its deletion", _KEPT, source="world_object.proto")
def world_object_is_kept(server: Server) -> str:
    """Draw a frame in odom, and delete it."""

    def mutate(action: str, thing: world_object_pb2.WorldObject) -> int:
        mutation = {"action": action, "object": thing}
        return int(server.ask("world-objects", "MutateWorldObjects", mutation=mutation).mutated_object_id)

    def is_listed() -> bool:
        objects = server.robot.ensure_client("world-objects").list_world_objects().world_objects
        return thing.id in {int(listed.id) for listed in objects}

    thing = world_object_pb2.WorldObject(name=_TRIAL, acquisition_time=server.robot_stamp(0.0))
    drawn = thing.drawable_properties.add(frame_name_drawable="odom")
    drawn.frame.arrow_length, drawn.frame.arrow_radius, drawn.color.a = 0.1, 0.01, 1.0
    thing.id = mutate("ACTION_ADD", thing)
    try:
        was_listed = is_listed()
    finally:
        mutate("ACTION_DELETE", thing)
    return _kept(was_listed, is_listed())


def _kept(was_listed: bool, is_listed: bool) -> str:
    if not was_listed:
        return "not listed"
    return "still listed" if is_listed else _KEPT


@check("TimeSync.TimeSyncUpdate: clock_identifier", "two new clients", "two identifiers", source="time_sync.proto")
def identifiers_differ(server: Server) -> str:
    """Each client gets an identifier of its own."""
    first, second = (server.ask("time-sync", "TimeSyncUpdate") for _ in range(2))
    return "two identifiers" if first.clock_identifier != second.clock_identifier else "one identifier"


@check("any call: method", "a method of no service", "UNIMPLEMENTED", source="gRPC: status codes")
def unknown_method(server: Server) -> str:
    """Call what is not there."""
    call = server.robot.ensure_channel("robot-state").unary_unary("/bosdyn.api.NoSuchService/NoSuchMethod")
    call(b"", timeout=RPC_TIMEOUT_S)
    return "OK"


@check("Image.GetImage", "the first source", "as large as it says", source="image.proto")
def image_is_as_large_as_its_source(server: Server) -> str:
    """A raw image has rows, columns and bytes as its source says."""
    client: Any = server.robot.ensure_client("image")
    sources = [s for s in client.list_image_sources() if image_pb2.Image.FORMAT_RAW in s.image_formats]
    if not sources:
        raise SkippedError("no source has raw images")
    source = next((s for s in sources if s.image_type == s.IMAGE_TYPE_DEPTH), sources[0])
    shot = client.get_image(
        [image_pb2.ImageRequest(image_source_name=source.name, image_format=image_pb2.Image.FORMAT_RAW)]
    )[0]
    image, edges = shot.shot.image, shot.shot.transforms_snapshot.child_to_parent_edge_map
    if (image.cols, image.rows) != (source.cols, source.rows):
        return f"{image.cols} by {image.rows}, source {source.cols} by {source.rows}"
    if source.image_type == source.IMAGE_TYPE_DEPTH and len(image.data) != 2 * image.cols * image.rows:
        return f"{len(image.data)} bytes"
    return "as large as it says" if shot.shot.frame_name_image_sensor in edges else "its sensor has no frame"


@check("License.GetLicenseInfo", "", "a status", source="license.proto")
def license_is_told(server: Server) -> str:
    """The licence has a status."""
    return "a status" if server.robot.ensure_client("license").get_license_info().status else "no status"
