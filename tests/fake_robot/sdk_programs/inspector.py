# ruff: noqa: T201 - a program prints
"""Look at everything that a robot tells of itself, and ask for what it has not. Usage: inspector.py HOSTNAME."""

import sys
import time

import bosdyn.client
import bosdyn.client.util
from bosdyn.api import service_fault_pb2
from bosdyn.client.data_acquisition import DataAcquisitionClient
from bosdyn.client.directory import DirectoryClient, NonexistentServiceError
from bosdyn.client.fault import FaultClient, ServiceFaultAlreadyExistsError, ServiceFaultDoesNotExistError
from bosdyn.client.lease import LeaseClient, LeaseKeepAlive
from bosdyn.client.robot import UnregisteredServiceNameError
from bosdyn.client.robot_command import (
    NotClearedError,
    RobotCommandBuilder,
    RobotCommandClient,
    blocking_selfright,
    blocking_sit,
    blocking_stand,
)
from bosdyn.client.robot_id import RobotIdClient
from bosdyn.client.robot_state import RobotStateClient
from bosdyn.client.time_sync import NotEstablishedError, TimeSyncClient, TimeSyncEndpoint, TimeSyncThread
from bosdyn.util import secs_to_hms


def faults(robot):
    client = robot.ensure_client(FaultClient.default_service_name)
    fault = service_fault_pb2.ServiceFault()
    fault.fault_id.fault_name, fault.fault_id.service_name = "lens", "inspector"
    fault.error_message, fault.severity = "dirty", service_fault_pb2.ServiceFault.SEVERITY_WARN
    client.trigger_service_fault(fault)
    try:
        client.trigger_service_fault(fault)
    except ServiceFaultAlreadyExistsError:
        print("the fault is there already")
    state = robot.ensure_client(RobotStateClient.default_service_name).get_robot_state()
    assert [f.fault_id.fault_name for f in state.service_fault_state.faults] == ["lens"]
    client.clear_service_fault(fault.fault_id)
    try:
        client.clear_service_fault(fault.fault_id)
    except ServiceFaultDoesNotExistError:
        print("the fault is gone already")


def clocks(robot):
    endpoint = TimeSyncEndpoint(robot.ensure_client(TimeSyncClient.default_service_name))
    try:
        endpoint.get_robot_time_converter()
    except NotEstablishedError:
        print("no clock yet")
    assert endpoint.establish_timesync(max_samples=20, break_on_success=True)
    converter = endpoint.get_robot_time_converter()
    now = time.time()
    robot_now = converter.robot_seconds_from_local_seconds(now)
    there = converter.robot_timestamp_from_local_secs(now)
    assert abs(converter.local_seconds_from_robot_timestamp(there) - now) < 1e-3
    print("clock id", bool(endpoint.clock_identifier), "skew sign", "-" if robot_now < now else "+")
    thread = TimeSyncThread(robot.ensure_client(TimeSyncClient.default_service_name))
    thread.start()
    thread.wait_for_sync(timeout_sec=10)
    assert thread.has_established_time_sync
    assert not thread.stopped
    thread.stop()
    assert thread.stopped


def main():
    robot = bosdyn.client.create_standard_sdk("Inspector").create_robot(sys.argv[1])
    bosdyn.client.util.authenticate(robot)
    identity = robot.ensure_client(RobotIdClient.default_service_name).get_id()
    print("robot", identity.species, identity.software_release.version.major_version)
    directory = robot.ensure_client(DirectoryClient.default_service_name)
    services = {entry.name for entry in directory.list()}
    assert {"robot-state", "robot-command", "lease", "estop", "power", "time-sync"} <= services
    assert directory.get_entry("power").type == "bosdyn.api.PowerService"
    try:
        directory.get_entry("no-such-service")
    except NonexistentServiceError:
        print("no such service")
    capabilities = robot.ensure_client(DataAcquisitionClient.default_service_name).get_service_info()
    print("can capture", [(s.service_name, len(s.image_source_names)) for s in capabilities.image_sources])
    try:
        robot.ensure_client("a-payload-of-mine")
    except UnregisteredServiceNameError:
        print("no such payload")
    commands = robot.ensure_client(RobotCommandClient.default_service_name)
    clocks(robot)
    faults(robot)
    states = robot.ensure_client(RobotStateClient.default_service_name)
    hardware = states.get_hardware_config_with_link_info()
    print("links", len(hardware.skeleton.links), "joints", len(states.get_robot_state().kinematic_state.joint_states))
    print("uptime", secs_to_hms(int(states.get_robot_metrics().metrics[0].duration.seconds)) != "")
    robot.time_sync.wait_for_sync()
    with LeaseKeepAlive(robot.ensure_client(LeaseClient.default_service_name), must_acquire=True, return_at_exit=True):
        robot.power_on(timeout_sec=20)
        blocking_selfright(commands, timeout_sec=20)
        blocking_stand(commands, timeout_sec=10)
        try:
            commands.clear_behavior_fault(4711)
        except NotClearedError:
            print("no such behaviour fault")
        commands.robot_command(RobotCommandBuilder.freeze_command())
        commands.robot_command(RobotCommandBuilder.stop_command())
        blocking_sit(commands, timeout_sec=15)
        commands.robot_command(RobotCommandBuilder.safe_power_off_command())
        deadline = time.time() + 20
        while robot.is_powered_on():
            assert time.time() < deadline
            time.sleep(0.1)
    print("done")


if __name__ == "__main__":
    main()
