"""Every service of the robot, hung onto one gRPC server."""

from __future__ import annotations

import grpc
from bosdyn.api import (
    auth_service_pb2,
    data_acquisition_service_pb2,
    data_acquisition_store_service_pb2,
    data_buffer_service_pb2,
    data_service_pb2,
    directory_registration_service_pb2,
    directory_service_pb2,
    estop_service_pb2,
    fault_service_pb2,
    image_service_pb2,
    lease_service_pb2,
    license_service_pb2,
    payload_registration_service_pb2,
    payload_service_pb2,
    power_service_pb2,
    robot_command_service_pb2,
    robot_command_service_pb2_grpc,
    robot_id_service_pb2,
    robot_state_service_pb2,
    time_sync_service_pb2,
    world_object_service_pb2,
)
from bosdyn.api.keepalive import keepalive_service_pb2

from fake_robot.services.authority.estop import EstopService
from fake_robot.services.authority.keepalive import KeepaliveService
from fake_robot.services.authority.lease import LeaseService
from fake_robot.services.authority.power import PowerService
from fake_robot.services.calls.access import UnknownServiceHandler
from fake_robot.services.calls.unary import UnaryServices
from fake_robot.services.identity.auth import AuthService
from fake_robot.services.identity.directory import DirectoryRegistrationService, DirectoryService
from fake_robot.services.identity.license import LicenseService
from fake_robot.services.identity.payload import PayloadRegistrationService, PayloadService
from fake_robot.services.identity.robot_id import RobotIdService
from fake_robot.services.identity.time_sync import TimeSyncService
from fake_robot.services.motion.command_streaming import RobotCommandStreamingService
from fake_robot.services.motion.robot_command import RobotCommandService
from fake_robot.services.reports.data_buffer import DataBufferService, DataService
from fake_robot.services.reports.fault import FaultService
from fake_robot.services.reports.robot_state import RobotStateService, stream_handler
from fake_robot.services.sensors.cameras import ImageService
from fake_robot.services.sensors.captures import Captures, DataAcquisitionService, DataAcquisitionStoreService
from fake_robot.services.sensors.world import World
from fake_robot.services.sensors.world_objects import WorldObjectService
from fake_robot.services.stubs import ANSWERS


def add_services(server: grpc.Server, world: World, username: str) -> None:
    """Add every service; the full name of a method tells them apart, so one server has room for all."""
    licence = LicenseService(world.config.serial_number, lambda: world.license_state, world.now_ns)
    images, captures = ImageService(world), Captures()
    own = {
        auth_service_pb2: AuthService(world.tokens),
        directory_service_pb2: DirectoryService(world.directory),
        directory_registration_service_pb2: DirectoryRegistrationService(world.directory),
        robot_id_service_pb2: RobotIdService(world.config),
        time_sync_service_pb2: TimeSyncService(world.time_sync),
        estop_service_pb2: EstopService(world.estop, world.apply_estop),
        lease_service_pb2: LeaseService(world.leases, username),
        power_service_pb2: PowerService(world),
        robot_state_service_pb2: RobotStateService(world),
        robot_command_service_pb2: RobotCommandService(world),
        license_service_pb2: licence,
        payload_service_pb2: PayloadService(world.payloads),
        payload_registration_service_pb2: PayloadRegistrationService(world.payloads, world.tokens),
        fault_service_pb2: FaultService(world.service_faults),
        keepalive_service_pb2: KeepaliveService(world.keepalive),
        data_buffer_service_pb2: DataBufferService(world.notes),
        data_service_pb2: DataService(world.notes),
        image_service_pb2: images,
        data_acquisition_service_pb2: DataAcquisitionService(world, images, captures),
        data_acquisition_store_service_pb2: DataAcquisitionStoreService(captures),
        world_object_service_pb2: WorldObjectService(world.robot.snapshot),
    }
    services = {f"{module.DESCRIPTOR.package}.{type(service).__name__}": service for module, service in own.items()}
    robot_command_service_pb2_grpc.add_RobotCommandStreamingServiceServicer_to_server(
        RobotCommandStreamingService(world), server
    )
    # The first handler that takes a method wins: the stream of bytes, our own services and tables, then nobody's.
    unary = UnaryServices(services, ANSWERS, world)
    server.add_generic_rpc_handlers(
        (stream_handler(world), unary, UnknownServiceHandler(world.directory.address_of_type))
    )
