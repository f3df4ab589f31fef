"""Every service of the robot, hung onto one gRPC server."""

from __future__ import annotations

import grpc
from bosdyn.api import (
    auth_service_pb2_grpc,
    data_buffer_service_pb2_grpc,
    data_service_pb2_grpc,
    directory_registration_service_pb2_grpc,
    directory_service_pb2_grpc,
    estop_service_pb2_grpc,
    fault_service_pb2_grpc,
    image_service_pb2_grpc,
    lease_service_pb2_grpc,
    license_service_pb2_grpc,
    payload_registration_service_pb2_grpc,
    payload_service_pb2_grpc,
    power_service_pb2_grpc,
    robot_command_service_pb2_grpc,
    robot_id_service_pb2_grpc,
    robot_state_service_pb2_grpc,
    time_sync_service_pb2_grpc,
    world_object_service_pb2_grpc,
)
from bosdyn.api.keepalive import keepalive_service_pb2_grpc

from fake_robot.services.authority.estop import EstopService
from fake_robot.services.authority.keepalive import KeepaliveService
from fake_robot.services.authority.lease import LeaseService
from fake_robot.services.authority.power import PowerService
from fake_robot.services.calls.access import UnknownServiceHandler
from fake_robot.services.calls.canned import CannedServices
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
from fake_robot.services.sensors.world import World
from fake_robot.services.sensors.world_objects import WorldObjectService
from fake_robot.services.stubs import ANSWERS


def add_services(server: grpc.Server, world: World, username: str) -> None:
    """Add every service; the full name of a method tells them apart, so one server has room for all."""
    auth_service_pb2_grpc.add_AuthServiceServicer_to_server(AuthService(world.tokens), server)
    directory_service_pb2_grpc.add_DirectoryServiceServicer_to_server(DirectoryService(world.directory), server)
    directory_registration_service_pb2_grpc.add_DirectoryRegistrationServiceServicer_to_server(
        DirectoryRegistrationService(world.directory), server
    )
    robot_id_service_pb2_grpc.add_RobotIdServiceServicer_to_server(RobotIdService(world.config), server)
    time_sync_service_pb2_grpc.add_TimeSyncServiceServicer_to_server(TimeSyncService(world.time_sync), server)
    estop_service_pb2_grpc.add_EstopServiceServicer_to_server(EstopService(world.estop, world.apply_estop), server)
    lease_service_pb2_grpc.add_LeaseServiceServicer_to_server(LeaseService(world.leases, username), server)
    power_service_pb2_grpc.add_PowerServiceServicer_to_server(PowerService(world), server)
    robot_state_service_pb2_grpc.add_RobotStateServiceServicer_to_server(RobotStateService(world), server)
    robot_command_service_pb2_grpc.add_RobotCommandServiceServicer_to_server(RobotCommandService(world), server)
    robot_command_service_pb2_grpc.add_RobotCommandStreamingServiceServicer_to_server(
        RobotCommandStreamingService(world), server
    )
    license_service_pb2_grpc.add_LicenseServiceServicer_to_server(
        LicenseService(world.config.serial_number, lambda: world.license_state, world.now_ns), server
    )
    payload_service_pb2_grpc.add_PayloadServiceServicer_to_server(PayloadService(world.payloads), server)
    payload_registration_service_pb2_grpc.add_PayloadRegistrationServiceServicer_to_server(
        PayloadRegistrationService(world.payloads, world.tokens), server
    )
    fault_service_pb2_grpc.add_FaultServiceServicer_to_server(FaultService(world.service_faults), server)
    keepalive_service_pb2_grpc.add_KeepaliveServiceServicer_to_server(KeepaliveService(world.keepalive), server)
    data_buffer_service_pb2_grpc.add_DataBufferServiceServicer_to_server(DataBufferService(world.notes), server)
    data_service_pb2_grpc.add_DataServiceServicer_to_server(DataService(world.notes), server)
    image_service_pb2_grpc.add_ImageServiceServicer_to_server(ImageService(world), server)
    world_object_service_pb2_grpc.add_WorldObjectServiceServicer_to_server(
        WorldObjectService(world.robot.snapshot), server
    )
    # The first handler that takes a method wins: the stream of bytes, the table of answers, then whatever nobody took.
    server.add_generic_rpc_handlers((stream_handler(world), CannedServices(ANSWERS, world), UnknownServiceHandler()))
